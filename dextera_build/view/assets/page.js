"use strict";
// What dxb adds to a page of viser: photographs without tone mapping, and in a saved page the panel of the scene.
(() => {
  const controls = window.dxbControls || [];
  const viewer = () => window.__viserMutable;

  // Textures that glow hold the light of the photograph already: they are shown as they are.
  const plain = () => {
    const view = viewer();
    if (!view || !view.scene) return;
    let changed = false;
    view.scene.traverse((part) => {
      [].concat(part.material || []).forEach((material) => {
        if (!material.emissiveMap || !material.toneMapped) return;
        material.toneMapped = false;
        // A black surface still reflects the lamps a little.
        material.onBeforeCompile = (shader) => {
          const end = "#include <opaque_fragment>";
          shader.fragmentShader = shader.fragmentShader.replace(end, `outgoingLight = totalEmissiveRadiance;\n${end}`);
        };
        material.customProgramCacheKey = () => "dxb plain";
        material.needsUpdate = changed = true;
      });
    });
    if (changed) view.requestRender();
  };
  setInterval(plain, 250);
  if (!controls.length) return;

  const changes = new Map(); // control -> its messages, sent again after a recording began anew
  const send = (messages) => {
    const view = viewer();
    if (!view) return;
    messages.forEach((message) => view.messageQueue.push({ owner: "", ...message }));
    view.requestRender();
  };
  const set = (control, messages) => {
    changes.set(control, messages);
    send(messages);
  };

  const element = (name, properties, ...children) => {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
  };
  const shown = (names, visible) =>
    names.map((name) => ({ type: "SetSceneNodeVisibilityMessage", name, visible }));

  const makers = {
    switch: (control) => {
      const box = element("input", { type: "checkbox", checked: control.on });
      box.addEventListener("change", () => set(control, shown(control.names, box.checked)));
      return element("label", { className: "switch" }, box, ` ${control.title}`);
    },
    slider: (control) => {
      const values = control.values;
      const nearest = values.reduce((best, v, i) => (Math.abs(v - control.start) < Math.abs(values[best] - control.start) ? i : best), 0);
      const told = element("output", {}, values[nearest].toFixed(0));
      const bar = element("input", { type: "range", min: 0, max: values.length - 1, step: 1, value: nearest });
      bar.addEventListener("input", () => {
        const at = Number(bar.value);
        told.textContent = values[at].toFixed(0);
        set(control, Object.entries(control.poses).flatMap(([name, poses]) => [
          { type: "SetPositionMessage", name, position: poses[at].slice(0, 3) },
          { type: "SetOrientationMessage", name, wxyz: poses[at].slice(3) },
        ]));
      });
      return element("label", {}, `${control.title} `, told, bar);
    },
    wipe: (control) => {
      const told = element("output", {}, "0");
      const bar = element("input", { type: "range", min: 0, max: 100, step: 1, value: 0 });
      bar.addEventListener("input", () => {
        told.textContent = bar.value;
        set(control, shown([control.name], bar.value > 0));
        wipe(control.name, bar.value / 100);
      });
      return element("label", {}, `${control.title} `, told, bar);
    },
  };

  // A picture is a plane of four corners: its right ones move, and so does what they show.
  const wipe = (name, share) => {
    const group = viewer().nodeRefFromName[name];
    if (!group) return;
    group.traverse((part) => {
      if (!part.isMesh || !part.material.map) return;
      const { position, uv } = part.geometry.attributes;
      const width = part.geometry.parameters.width;
      for (const corner of [1, 3]) {
        position.setX(corner, (share - 0.5) * width);
        uv.setX(corner, share);
      }
      position.needsUpdate = uv.needsUpdate = true;
    });
    viewer().requestRender();
  };

  const panel = () => {
    const style = element("style", {}, `
      #dxb { position: fixed; top: 64px; right: 16px; z-index: 2; width: 15rem; max-width: calc(100vw - 84px);
        max-height: calc(100vh - 84px); overflow-y: auto; padding: 8px 12px; border-radius: 8px; background: rgb(255 255 255 / 0.94);
        color: #1b1e23; box-shadow: 0 1px 12px rgb(0 0 0 / 0.18); font: 14px/1.5 system-ui, sans-serif; }
      #dxb summary { cursor: pointer; font-weight: 600; }
      #dxb label { display: block; margin-top: 6px; }
      #dxb input[type=range] { width: 100%; }
      #dxb output { float: right; font-variant-numeric: tabular-nums; }
      #dxb button { margin-top: 8px; width: 100%; font: inherit; padding: 4px; }`);
    const back = element("button", { type: "button" }, "Look from the start");
    back.addEventListener("click", () => viewer() && viewer().resetCameraPose && viewer().resetCameraPose(true));
    const rows = controls.map((control) => makers[control.kind](control));
    const box = element("details", { id: "dxb", open: window.innerWidth > 700 }, element("summary", {}, "Show"), ...rows, back);
    document.body.append(style, box);
  };
  const start = () => (viewer() ? panel() : setTimeout(start, 200));
  start();
  // A recording that begins anew shows everything again.
  if (window.dxbMoves) setInterval(() => changes.forEach(send), 500);
})();
