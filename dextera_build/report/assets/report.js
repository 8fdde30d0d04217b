"use strict";
(() => {
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];
  const panel = document.getElementById("panel");
  const large = document.getElementById("large");
  let opener = null;

  // A node in the graph, the timeline or a link opens the panel; without scripts the link leads to the list of nodes.
  const open = (index, from) => {
    const node = document.getElementById("n" + index);
    if (!node) return;
    const heading = document.createElement("h3");
    heading.textContent = node.querySelector(".address").textContent;
    const said = document.createElement("p");
    said.className = "said";
    said.textContent = node.querySelector(".said").textContent;
    panel.lastElementChild.replaceChildren(heading, said, node.querySelector(".body").cloneNode(true));
    all("a[data-code]", panel).forEach((a) => {
      const files = document.querySelector(a.hash + " dl");
      if (files) a.parentElement.replaceWith(files.cloneNode(true));
    });
    all(".chosen").forEach((e) => e.classList.remove("chosen"));
    all(`svg [data-node="${index}"]`).forEach((e) => e.classList.add("chosen"));
    if (!panel.contains(from)) opener = from;
    panel.setAttribute("aria-label", heading.textContent);
    panel.hidden = false;
    panel.scrollTop = 0;
    panel.focus({ preventScroll: true });
  };
  const close = () => {
    if (panel.hidden) return;
    panel.hidden = true;
    all(".chosen").forEach((e) => e.classList.remove("chosen"));
    if (opener) opener.focus({ preventScroll: true });
  };

  // The largest copy of a picture that the page holds.
  const enlarge = (button) => {
    const image = button.querySelector("img");
    const copies = all(`img[data-picture="${image.dataset.picture}"]`);
    const best = copies.reduce((a, b) => (a.naturalWidth >= b.naturalWidth ? a : b), image);
    const shown = document.createElement("img");
    shown.src = best.src;
    shown.alt = image.alt;
    const caption = button.parentElement.querySelector("figcaption");
    const figure = large.querySelector("figure");
    figure.replaceChildren(shown);
    if (caption) figure.append(caption.cloneNode(true));
    large.showModal();
  };

  document.addEventListener("click", (event) => {
    const zoom = event.target.closest(".zoom");
    if (zoom) return enlarge(zoom);
    if (event.target === large || event.target.closest("#large .close")) return large.close();
    if (event.target.closest("#panel .close")) return close();
    const link = event.target.closest("a[data-node]");
    if (link && !event.ctrlKey && !event.metaKey) {
      event.preventDefault();
      open(link.dataset.node, link);
    }
  });
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && !large.open) close();
  });

  // Pointing at a node shows what it is made of and what is made of it.
  all(".graph svg").forEach((svg) => {
    const paths = all(".edges path", svg);
    const point = (index) => {
      all(".near", svg).forEach((e) => e.classList.remove("near"));
      svg.classList.toggle("pointed", index !== null);
      if (index === null) return;
      const near = new Set([index]);
      paths.forEach((path) => {
        if (path.dataset.a !== index && path.dataset.b !== index) return;
        path.classList.add("near");
        near.add(path.dataset.a).add(path.dataset.b);
      });
      all(".node", svg).forEach((node) => node.classList.toggle("near", near.has(node.dataset.node)));
    };
    all(".node", svg).forEach((node) => {
      node.addEventListener("mouseenter", () => point(node.dataset.node));
      node.addEventListener("mouseleave", () => point(null));
      node.addEventListener("focus", () => point(node.dataset.node));
      node.addEventListener("blur", () => point(null));
    });
  });

  const filter = document.getElementById("filter");
  if (filter) {
    filter.closest(".filter").hidden = false;
    const nodes = all("details.node").map((node) => {
      const rule = node.querySelector(".facts dd");
      return [node, (node.querySelector("summary").textContent + " " + (rule ? rule.textContent : "")).toLowerCase()];
    });
    filter.addEventListener("input", () => {
      const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
      nodes.forEach(([node, text]) => { node.hidden = !words.every((word) => text.includes(word)); });
    });
  }

  // The page in 3D takes the picture's place; it is neither read nor run before.
  const turn = document.getElementById("turn");
  if (turn) {
    const held = document.getElementById("turned"), fill = document.getElementById("fill");
    const picture = held.parentElement.querySelector(".hero");
    turn.parentElement.hidden = false;
    turn.addEventListener("click", () => {
      const open = held.hidden;
      const frame = document.createElement("iframe");
      if (open) {
        frame.title = "the result in 3D";
        frame.allow = "fullscreen";
        frame.srcdoc = JSON.parse(document.getElementById("view").textContent);
      }
      held.replaceChildren(...(open ? [frame] : []));
      held.hidden = !open;
      fill.hidden = !open || !document.fullscreenEnabled;
      if (picture) picture.classList.toggle("turned", open);
      turn.setAttribute("aria-expanded", open);
      turn.textContent = open ? "Back to the picture" : "Turn it in 3D";
    });
    fill.addEventListener("click", () => held.requestFullscreen());
  }

  // A film plays by itself, but not for those who asked for less motion.
  if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) all("video").forEach((film) => film.pause());

  const follow = () => {
    const node = /^#[nc]\d+$/.test(location.hash) && document.querySelector(location.hash);
    if (node) node.open = true;
  };
  window.addEventListener("hashchange", follow);
  follow();
})();
