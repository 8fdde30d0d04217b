// Hands by keyboard, mouse and gamepad: a wrist that keys move, and fingers that bend together.

import * as THREE from "./three.module.min.js";

const SPEED = 0.14, TURN = 0.9, CLOSE = 1.6, SLOW = 0.3;

export class Keys {
  constructor(canvas, twin, camera, orbit) {
    this.twin = twin;
    this.camera = camera;
    this.down = new Set();
    this.active = twin.facts.wrists.map((wrist) => wrist.side);
    this.choice = 0;
    this.closing = [0, 0];
    this.closed = [0, 0];
    this.drag = new THREE.Vector3();
    this.reset();
    window.addEventListener("keydown", (event) => this.press(event));
    window.addEventListener("keyup", (event) => this.down.delete(event.code));
    window.addEventListener("blur", () => this.down.clear());
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointermove", (event) => {
      if (event.pointerType === "touch") return;
      if (event.buttons === 1) orbit.turn(event.movementX, event.movementY);
      else if (event.buttons === 2) this.drag.add(new THREE.Vector3(event.movementX, -event.movementY, 0));
    });
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); orbit.zoom(event.deltaY); }, { passive: false });
  }

  // Hands lie at the robot's palms again.
  reset() {
    this.pivot = [null, null];
    this.turn = [null, null];
    this.arm = [null, null];
    for (const wrist of this.twin.facts.wrists) {
      const turn = new THREE.Quaternion(...wrist.pose.slice(3));
      const pivot = new THREE.Vector3(...wrist.palm);
      this.pivot[wrist.side] = pivot;
      this.turn[wrist.side] = turn;
      this.arm[wrist.side] = pivot.clone().sub(new THREE.Vector3(...wrist.pose.slice(0, 3))).applyQuaternion(turn.clone().invert());
    }
    this.closing = [0, 0];
    this.closed = [0, 0];
  }

  press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.code === "Tab") this.next();
    if (event.code === "Space") for (const hand of this.chosen()) this.closing[hand] = this.closing[hand] > 0.5 ? 0 : 1;
    if (["Tab", "Space", "Backspace", "End"].includes(event.code)) event.preventDefault();
    this.down.add(event.code);
  }

  // The other hand, or both.
  next() { this.choice = (this.choice + 1) % (this.active.length + 1); }

  chosen() { return this.active.length < 2 || this.choice === 2 ? this.active : [this.active[this.choice]]; }

  key(plus, minus) { return (this.down.has(plus) ? 1 : 0) - (this.down.has(minus) ? 1 : 0); }

  // Moves wrists by the time since the last call [s], and by what a finger on the screen has moved.
  step(seconds, touch) {
    const slow = this.down.has("ShiftLeft") || this.down.has("ShiftRight") ? SLOW : 1;
    const pad = [...(navigator.getGamepads?.() ?? [])].find((each) => each?.connected);
    const axis = (place) => (pad && Math.abs(pad.axes[place] ?? 0) > 0.12 ? pad.axes[place] : 0);
    const button = (place) => pad?.buttons[place]?.value ?? 0;
    const right = this.key("KeyD", "KeyA") + axis(0), ahead = this.key("KeyW", "KeyS") - axis(1);
    const up = this.key("KeyE", "KeyQ") + button(7) - button(6);
    // A stick that is pushed into a corner is not faster.
    const push = Math.max(1, Math.hypot(right, ahead));
    const way = this.floor(right / push, ahead / push).multiplyScalar(SPEED * slow * seconds);
    way.z += up * SPEED * slow * seconds;
    way.add(this.dragged());
    const moved = touch.taken(seconds);
    way.add(this.floor(moved.way.x, moved.way.y)).z += moved.way.z;
    const turned = new THREE.Quaternion().setFromEuler(new THREE.Euler(
      TURN * slow * seconds * (this.key("KeyN", "KeyM") + button(5) - button(4)) + moved.angles.x,
      TURN * slow * seconds * (this.key("KeyK", "KeyI") + axis(3)) + moved.angles.y,
      TURN * slow * seconds * (this.key("KeyJ", "KeyL") - axis(2)) + moved.angles.z,
    ));
    const bend = this.key("KeyC", "KeyV") + button(0) - button(1);
    for (const hand of this.chosen()) {
      this.pivot[hand].add(way);
      this.turn[hand].premultiply(turned);
      if (bend) this.closing[hand] = Math.min(1, Math.max(0, this.closed[hand] + bend * CLOSE * slow * seconds));
    }
    for (const hand of this.active) {
      const off = this.closing[hand] - this.closed[hand];
      this.closed[hand] += Math.sign(off) * Math.min(Math.abs(off), CLOSE * seconds);
    }
  }

  // A way on the floor as the camera sees it, in the axes of the base.
  floor(right, ahead) {
    const length = Math.hypot(right, ahead);
    if (!length) return new THREE.Vector3();
    const forward = this.camera.getWorldDirection(new THREE.Vector3()).setY(0).normalize();
    const side = new THREE.Vector3(-forward.z, 0, forward.x);
    const way = forward.multiplyScalar(ahead).addScaledVector(side, right);
    return way.transformDirection(this.twin.base.matrixWorld.clone().invert()).multiplyScalar(length);
  }

  dragged() {
    const far = this.camera.position.length();
    const way = this.drag.clone().multiplyScalar(0.0009 * far).applyQuaternion(this.camera.quaternion);
    this.drag.set(0, 0, 0);
    const length = way.length();
    return length ? way.transformDirection(this.twin.base.matrixWorld.clone().invert()).multiplyScalar(Math.min(length, 0.02)) : way;
  }

  // What is sent; a finger on the screen is the clutch of the hands that it moves.
  hands(touch) {
    const wrists = [0, 1].map((hand) => {
      if (!this.pivot[hand]) return [0, 0, 0, 0, 0, 0, 1];
      const place = this.pivot[hand].clone().sub(this.arm[hand].clone().applyQuaternion(this.turn[hand]));
      return [...place.toArray(), ...this.turn[hand].toArray()];
    });
    const there = [0, 1].map((hand) => (this.active.includes(hand) ? 1 : 0));
    const moves = (hand) => !touch.used || (touch.engaged && this.chosen().includes(hand));
    const clutch = there.map((each, hand) => (each && moves(hand) ? 1 : 0));
    return { wrists, closed: this.closed, pinch: this.closed, tracking: there.map((each) => 2 * each), clutch, base: true };
  }
}
