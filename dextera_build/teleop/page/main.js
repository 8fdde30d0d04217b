// The page of a live session.

import * as THREE from "./three.module.min.js";
import { Headset } from "./headset.js";
import { Keys } from "./keys.js";
import { Link } from "./link.js";
import * as panel from "./panel.js";
import { Touch } from "./touch.js";
import { Twin } from "./twin.js";

const canvas = document.getElementById("view");
const renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
const scene = new THREE.Scene();
scene.background = new THREE.Color(0x2b323a);
scene.add(new THREE.HemisphereLight(0xffffff, 0x8a8f98, 2.2));
const sun = new THREE.DirectionalLight(0xffffff, 1.8);
sun.position.set(1.5, 3, 2);
scene.add(sun);
const camera = new THREE.PerspectiveCamera(50, 1, 0.02, 50);

class Orbit {
  constructor(middle, from) {
    this.middle = middle;
    this.angles = new THREE.Spherical().setFromVector3(from);
    this.turn(0, 0);
  }

  turn(x, y) {
    this.angles.theta -= 0.006 * x;
    this.angles.phi = Math.min(1.5, Math.max(0.15, this.angles.phi - 0.006 * y));
    camera.position.setFromSpherical(this.angles).add(this.middle);
    camera.lookAt(this.middle);
  }

  zoom(by) {
    this.angles.radius = Math.min(4, Math.max(0.3, this.angles.radius * Math.exp(0.001 * by)));
    this.turn(0, 0);
  }
}

function fit() {
  if (renderer.xr.isPresenting) return;
  camera.aspect = innerWidth / innerHeight;
  // The panels cover the left side.
  if (innerWidth > 760) camera.setViewOffset(innerWidth, innerHeight, -150, 0, innerWidth, innerHeight);
  // The panel is above, and what a thumb needs is below.
  else camera.setViewOffset(innerWidth, innerHeight, 0, -0.09 * innerHeight, innerWidth, innerHeight);
  camera.updateProjectionMatrix();
  renderer.setSize(innerWidth, innerHeight, false);
}

let latest = null, note = "", noteUntil = 0;
const twin = await Twin.load();
document.getElementById("task").textContent = twin.facts.task;
const upright = new THREE.Group();
upright.rotation.x = -Math.PI / 2;
upright.add(twin.world);
scene.add(upright);
scene.updateMatrixWorld(true);

const look = new THREE.Vector3(...twin.facts.look).applyMatrix4(twin.base.matrixWorld);
const eye = new THREE.Vector3(...twin.facts.eye).applyMatrix4(twin.base.matrixWorld);
const orbit = new Orbit(look, eye.sub(look));
if (innerWidth < innerHeight) orbit.zoom(350);
const keys = new Keys(canvas, twin, camera, orbit);
window.addEventListener("resize", fit);
fit();

let phase = "";
function onState(facts, numbers) {
  twin.show(facts, numbers);
  if (!latest && facts.camera) {
    for (const name of ["keys", "touch", "headset"]) document.getElementById(name).style.display = "none";
  }
  // A take is relative to where the hands were at its beginning: to move them then would move the robot.
  if (facts.phase !== phase && facts.phase === "ready") keys.reset();
  phase = facts.phase;
  latest = facts;
}

function onWord(text, stays = false) {
  note = text;
  noteUntil = performance.now() + (stays ? 4000 : 800);
  if (!latest) document.getElementById("told").textContent = text;
}

const link = new Link(`keyboard and mouse in ${navigator.userAgent}`, onState, onWord);
const touch = new Touch(canvas, twin, camera, orbit, keys, () => link.name(`touch screen in ${navigator.userAgent}`));
const wish = (what) => link.send({ do: what });
for (const button of document.querySelectorAll("[data-do]")) {
  button.addEventListener("click", () => { wish(button.dataset.do); canvas.focus(); });
}
const DIRECT = { Enter: "start", KeyF: "finish", Backspace: "discard", KeyU: "undo", KeyX: "skip", KeyR: "recentre" };
window.addEventListener("keydown", (event) => {
  if (event.repeat || event.target instanceof HTMLButtonElement || event.ctrlKey || event.metaKey) return;
  if (DIRECT[event.code]) wish(DIRECT[event.code]);
});

const headset = new Headset(renderer, scene, upright, twin, link, wish);
headset.offer(document.getElementById("headset"));

// Hands are sent at a rate of their own: pictures may take longer.
let last = performance.now();
setInterval(() => {
  const now = performance.now();
  const seconds = Math.min(0.1, (now - last) / 1000);
  last = now;
  if (headset.active || latest?.camera) return;
  keys.step(seconds, touch);
  link.hands(keys.hands(touch));
}, 15);

renderer.setAnimationLoop((time, frame) => {
  const found = latest && panel.words(latest, link, performance.now() < noteUntil ? note : "");
  if (headset.active && frame) headset.step(frame, found, latest);
  else if (found) panel.show(found);
  renderer.render(scene, camera);
});
window.session = { link, twin, keys, touch, headset, get facts() { return latest; } };
