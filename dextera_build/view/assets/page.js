"use strict";
// What dxb adds to a page of viser: photographs without tone mapping, and in a saved page the panel of the scene.
(() => {
  const controls = window.dxbControls || [];
  const viewer = () => window.__viserMutable;
  const saved = window.__VISER_EMBED_CONFIG__;
  if (saved) saved.darkMode = window.matchMedia("(prefers-color-scheme: dark)").matches;

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
    robot: (control) => {
      const at = control.joints.map((joint) => joint.home);
      const move = () => set(control, posed(control, at));
      const rows = control.joints.map((joint, number) => {
        const { low, high, home, unit } = joint;
        const told = element("output", {}, (home * unit).toFixed(0));
        const bar = element("input", { type: "range", min: low, max: high, step: (high - low) / 500, value: home });
        bar.addEventListener("input", () => {
          at[number] = Number(bar.value);
          told.textContent = (at[number] * unit).toFixed(0);
          move();
        });
        const row = element("label", {}, `${joint.name} [${unit < 100 ? "deg" : "mm"}] `, told, bar);
        return { row, bar };
      });
      const home = element("button", { type: "button" }, "All joints at home");
      home.addEventListener("click", () =>
        rows.forEach(({ bar }, number) => {
          bar.value = control.joints[number].home;
          bar.dispatchEvent(new Event("input"));
        }));
      return element("div", {}, ...rows.map(({ row }) => row), home);
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

  // Poses are position and quaternion w, x, y, z.
  const times = ([a, b, c, d], [e, f, g, h]) =>
    [a * e - b * f - c * g - d * h, a * f + b * e + c * h - d * g, a * g - b * h + c * e + d * f, a * h + b * g - c * f + d * e];
  const turned = (q, v) => times(times(q, [0, ...v]), [q[0], -q[1], -q[2], -q[3]]).slice(1);
  const sum = (a, b, by = 1) => a.map((value, i) => value + by * b[i]);
  const within = ([p, q], pose) => [sum(p, turned(q, pose.slice(0, 3))), times(q, pose.slice(3))];
  const jointed = ([p, q], joint, by) => {
    if (!joint.turns) return [sum(p, turned(q, joint.axis), by), q];
    const spun = times(q, [Math.cos(by / 2), ...joint.axis.map((value) => value * Math.sin(by / 2))]);
    return [sum(sum(p, turned(q, joint.at)), turned(spun, joint.at), -1), spun];
  };
  // Messages that pose the nodes of a robot whose joints are `at` [rad or m]; see view/kinematic.py.
  const posed = (robot, at) => {
    const poses = [[[0, 0, 0], [1, 0, 0, 0]]];
    robot.bodies.forEach((body) => {
      const start = within(poses[body.parent], body.pose);
      poses.push(body.joints.reduce(
        (pose, joint) => jointed(pose, joint, (joint.of < 0 ? 0 : joint.ratio * at[joint.of]) + joint.offset), start));
    });
    return robot.nodes.flatMap((node) => {
      const [p, wxyz] = within(poses[node.body], node.pose);
      const name = node.name;
      return [
        { type: "SetPositionMessage", name, position: [p[0], p[1], p[2] + (node.above || 0)] },
        { type: "SetOrientationMessage", name, wxyz },
      ];
    });
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
      #dxb button { margin-top: 8px; width: 100%; font: inherit; padding: 4px; }
      @media (prefers-color-scheme: dark) { #dxb { background: rgb(25 28 32 / 0.94); color: #e6e8eb; color-scheme: dark; } }`);
    const back = element("button", { type: "button" }, "Look from the start");
    back.addEventListener("click", () => viewer() && viewer().resetCameraPose && viewer().resetCameraPose(true));
    const rows = controls.map((control) => makers[control.kind](control));
    const box = element("details", { id: "dxb", open: window.innerWidth > 900 }, element("summary", {}, "Show"), ...rows, back);
    document.body.append(style, box);
  };
  const start = () => (viewer() ? panel() : setTimeout(start, 200));
  start();
  // A recording that begins anew shows everything again.
  if (window.dxbMoves) setInterval(() => changes.forEach(send), 500);
})();
