// A phone: the hand moves while the picture is pressed and held, and a slider closes it.

import * as THREE from "./three.module.min.js";

const HOLD_MS = 180; // a shorter tap moves nothing
const FASTEST = 0.6; // of a hand [m/s]; the excess is dropped
const TURN = 0.006; // of one finger [rad/pixel]

export class Touch {
  constructor(canvas, twin, camera, orbit, keys, onUse) {
    Object.assign(this, { canvas, twin, camera, orbit, keys, onUse });
    this.used = false;
    this.engaged = false;
    this.what = "move";
    this.fingers = new Map();
    this.way = new THREE.Vector3(); // right, ahead, up [m]
    this.angles = new THREE.Vector3(); // roll, pitch, yaw [rad]
    this.section = document.getElementById("touch");
    this.slider = document.getElementById("closed");
    this.slider.addEventListener("input", () => {
      for (const hand of keys.chosen()) keys.closing[hand] = Number(this.slider.value);
    });
    for (const button of this.section.querySelectorAll("[data-drag]")) {
      button.addEventListener("click", () => this.choose(button.dataset.drag));
    }
    const other = document.getElementById("other");
    other.hidden = keys.active.length < 2;
    other.addEventListener("click", () => { keys.next(); this.name(other); });
    this.name(other);
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) canvas.addEventListener(kind, (event) => this.up(event));
    if (matchMedia("(pointer: coarse)").matches) this.use();
  }

  use() {
    if (this.used) return;
    this.used = true;
    this.section.hidden = false;
    document.getElementById("keys").hidden = true;
    document.body.classList.add("touched");
    this.choose("move");
    this.onUse();
  }

  choose(what) {
    this.what = what;
    for (const button of this.section.querySelectorAll("[data-drag]")) button.setAttribute("aria-pressed", String(button.dataset.drag === what));
  }

  name(button) {
    const sides = this.keys.chosen().map((hand) => ["left", "right"][hand]);
    button.textContent = sides.length > 1 ? "both hands" : `${sides[0]} hand`;
  }

  down(event) {
    if (event.pointerType !== "touch") return;
    this.use();
    event.preventDefault();
    this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, new THREE.Vector2(event.clientX, event.clientY));
    clearTimeout(this.timer);
    if (this.fingers.size > 1) this.engage();
    else this.timer = setTimeout(() => this.engage(), HOLD_MS);
  }

  engage() {
    if (this.what === "view" || this.engaged || !this.fingers.size) return;
    this.engaged = true;
    navigator.vibrate?.(15);
  }

  up(event) {
    this.fingers.delete(event.pointerId);
    if (this.fingers.size) return;
    clearTimeout(this.timer);
    this.engaged = false;
    this.way.set(0, 0, 0);
    this.angles.set(0, 0, 0);
  }

  moved(event) {
    const finger = this.fingers.get(event.pointerId);
    if (!finger) return;
    const other = [...this.fingers.values()].find((each) => each !== finger);
    const was = finger.clone();
    finger.set(event.clientX, event.clientY);
    const [x, y] = [finger.x - was.x, finger.y - was.y];
    if (this.what === "view") {
      if (other) this.orbit.zoom(700 * Math.log(was.distanceTo(other) / Math.max(1, finger.distanceTo(other))));
      else this.orbit.turn(x, y);
    } else if (this.engaged && other) {
      const angle = (place) => Math.atan2(place.y - other.y, place.x - other.x);
      const twist = angle(finger) - angle(was);
      // Clockwise on the screen is clockwise from above.
      this.angles.z -= Math.atan2(Math.sin(twist), Math.cos(twist));
      this.way.z -= 0.5 * y * this.metres();
    } else if (this.engaged && this.what === "turn") {
      this.angles.x += TURN * x;
      this.angles.y += TURN * y;
    } else if (this.engaged) {
      this.way.x += x * this.metres();
      this.way.y -= y * this.metres();
    }
  }

  // Size of a pixel where the hand is [m], so that the hand stays below the finger.
  metres() {
    const hand = this.keys.pivot[this.keys.chosen()[0]].clone().applyMatrix4(this.twin.base.matrixWorld);
    return 2 * Math.tan(THREE.MathUtils.degToRad(this.camera.fov / 2)) * this.camera.position.distanceTo(hand) / innerHeight;
  }

  // Motion since the last call: right, ahead and up [m], and angles about the axes of the base [rad].
  taken(seconds) {
    const way = this.way.clone().clampLength(0, FASTEST * seconds), angles = this.angles.clone();
    this.way.set(0, 0, 0);
    this.angles.set(0, 0, 0);
    if (document.activeElement !== this.slider || !this.engaged) this.slider.value = this.keys.closing[this.keys.chosen()[0]];
    return { way, angles };
  }
}
