// A headset: joints of both hands, or controllers, and a board with buttons to touch.

import * as THREE from "./three.module.min.js";
import { board } from "./panel.js";

const AWAY = 0.45, BELOW = 0.35; // of the robot's palms from the head [m]
const CLUTCH = 0.018, CLEAR = 0.05; // thumb at the little finger, and away from the index finger [m]
const THUMB = 4, INDEX = 9, LITTLE = 24;
const BUTTONS = ["start", "finish", "discard", "undo", "recentre"];
const PRESS_S = 0.8;

export class Headset {
  constructor(renderer, scene, upright, twin, link, wish) {
    Object.assign(this, { renderer, scene, upright, twin, link, wish });
    this.active = false;
    this.placed = null;
    this.turn = null; // from the axes of the base to those of the room
    this.pressed = 0;
    this.lastBoard = 0;
    this.joints = new Float32Array(350);
    const canvas = document.createElement("canvas");
    canvas.width = 900;
    canvas.height = 430;
    this.paper = canvas.getContext("2d");
    this.print = new THREE.CanvasTexture(canvas);
    this.print.colorSpace = THREE.SRGBColorSpace;
    this.board = new THREE.Group();
    const plane = new THREE.Mesh(new THREE.PlaneGeometry(0.45, 0.215), new THREE.MeshBasicMaterial({ map: this.print }));
    this.board.add(plane);
    this.targets = BUTTONS.map((name, place) => this.button(name, place));
    this.board.visible = false;
    scene.add(this.board);
  }

  button(name, place) {
    const canvas = document.createElement("canvas");
    canvas.width = 192;
    canvas.height = 96;
    const paper = canvas.getContext("2d");
    paper.fillStyle = name === "start" ? "#1f6f4a" : "#30363d";
    paper.fillRect(0, 0, 192, 96);
    paper.fillStyle = "#e6edf3";
    paper.font = "34px system-ui, sans-serif";
    paper.textAlign = "center";
    paper.fillText(name, 96, 60);
    const map = new THREE.CanvasTexture(canvas);
    map.colorSpace = THREE.SRGBColorSpace;
    const mesh = new THREE.Mesh(new THREE.BoxGeometry(0.084, 0.042, 0.012), new THREE.MeshBasicMaterial({ map }));
    mesh.position.set(-0.184 + 0.092 * place, -0.14, 0);
    mesh.name = name;
    this.board.add(mesh);
    return mesh;
  }

  async offer(button) {
    const fits = await navigator.xr?.isSessionSupported("immersive-vr").catch(() => false);
    button.hidden = !fits;
    button.addEventListener("click", () => this.enter());
  }

  async enter() {
    try { await this.begin(); } catch (error) { this.link.onWord(`the headset refused: ${error.message}`, true); }
  }

  async begin() {
    const wanted = { requiredFeatures: ["local-floor"], optionalFeatures: ["hand-tracking"] };
    const session = await navigator.xr.requestSession("immersive-vr", wanted);
    this.renderer.xr.enabled = true;
    this.renderer.xr.setReferenceSpaceType("local-floor");
    await this.renderer.xr.setSession(session);
    this.active = true;
    this.placed = null;
    this.board.visible = true;
    this.link.name(`WebXR in ${navigator.userAgent}`);
    session.addEventListener("end", () => this.leave());
  }

  leave() {
    this.active = false;
    this.board.visible = false;
    this.renderer.xr.enabled = false;
    this.upright.matrixAutoUpdate = true;
    this.upright.rotation.set(-Math.PI / 2, 0, 0);
    this.upright.position.set(0, 0, 0);
    this.upright.updateMatrix();
    for (const hand of this.twin.hands) hand.group.position.set(0, 0, 0);
    this.turn = null;
  }

  step(frame, found, facts) {
    const space = this.renderer.xr.getReferenceSpace();
    const viewer = frame.getViewerPose(space);
    const head = viewer ? numbers(viewer.transform) : null;
    const inputs = [...frame.session.inputSources].filter((each) => each.handedness === "left" || each.handedness === "right");
    const tracked = inputs.filter((each) => each.hand);
    if (tracked.length) this.sendJoints(frame, space, tracked, head);
    else this.sendControllers(frame, space, inputs, head);
    if (head && facts) this.place(head, facts.heading);
    if (found && performance.now() - this.lastBoard > 200) {
      this.lastBoard = performance.now();
      board(this.paper, this.twin.facts.task, found);
      this.print.needsUpdate = true;
    }
  }

  sendJoints(frame, space, inputs, head) {
    const tracking = [0, 0], clutch = [0, 0], pinch = [0, 0];
    this.joints.fill(0);
    for (const input of inputs) {
      const hand = input.handedness === "left" ? 0 : 1;
      tracking[hand] = this.read(frame, space, input.hand, 175 * hand);
      if (!tracking[hand]) continue;
      const apart = (one, other) => this.tip(hand, one).distanceTo(this.tip(hand, other));
      clutch[hand] = apart(THUMB, LITTLE) < CLUTCH && apart(THUMB, INDEX) > CLEAR ? 0 : 1;
      pinch[hand] = Math.min(1, Math.max(0, (0.06 - apart(THUMB, INDEX)) / 0.045));
      this.touch(this.tip(hand, INDEX));
    }
    if (this.turn) for (const hand of [0, 1]) this.draw(hand, tracking[hand]);
    this.link.hands({ joints: this.joints, tracking, clutch, pinch, head });
  }

  // State of tracking: 0 lost, 1 predicted, 2 measured.
  read(frame, space, hand, at) {
    let state = 2, place = at;
    for (const joint of hand.values()) {
      const pose = frame.getJointPose(joint, space);
      if (!pose) return 0;
      if (pose.emulatedPosition) state = 1;
      this.joints.set(numbers(pose.transform), place);
      place += 7;
    }
    return place === at + 175 ? state : 0;
  }

  // Hands are drawn where they are in this picture: the session's states are older, and fewer.
  draw(hand, tracked) {
    const back = this.turn.clone().transpose(), own = new Float32Array(75).fill(NaN);
    for (let joint = 0; tracked && joint < 25; joint += 1) this.tip(hand, joint).applyMatrix4(back).toArray(own, 3 * joint);
    this.twin.drawHand(this.twin.hands[hand], own, 0);
  }

  tip(hand, joint) { return new THREE.Vector3().fromArray(this.joints, 175 * hand + 7 * joint); }

  // A controller's trigger closes the fingers, and its grip button is the clutch.
  sendControllers(frame, space, inputs, head) {
    const sent = { wrists: [[0, 0, 0, 0, 0, 0, 1], [0, 0, 0, 0, 0, 0, 1]], closed: [0, 0], pinch: [0, 0], tracking: [0, 0], clutch: [0, 0], head };
    for (const input of inputs) {
      const hand = input.handedness === "left" ? 0 : 1;
      const pose = input.gripSpace && frame.getPose(input.gripSpace, space);
      if (!pose) continue;
      sent.wrists[hand] = numbers(pose.transform);
      sent.tracking[hand] = pose.emulatedPosition ? 1 : 2;
      sent.closed[hand] = sent.pinch[hand] = input.gamepad?.buttons[0]?.value ?? 0;
      sent.clutch[hand] = input.gamepad?.buttons[1]?.pressed ? 1 : 0;
      this.touch(new THREE.Vector3(...sent.wrists[hand]));
    }
    this.link.hands(sent);
  }

  // The robot stands where its palms are before the operator, turned as the operator's heading says.
  place(head, heading) {
    if (this.placed === heading) return;
    this.placed = heading;
    const axes = new THREE.Matrix4().set(0, -1, 0, 0, 0, 0, 1, 0, -1, 0, 0, 0, 0, 0, 0, 1);
    const turn = axes.multiply(new THREE.Matrix4().makeRotationZ(-heading));
    const middle = new THREE.Vector3(...this.twin.facts.middle).applyMatrix4(turn);
    const eye = new THREE.Vector3(...head);
    const ahead = new THREE.Vector3(AWAY, 0, 0).applyMatrix4(turn);
    const shift = eye.clone().add(ahead).sub(middle);
    shift.y -= BELOW;
    const base = new THREE.Matrix4().makeTranslation(shift).multiply(turn);
    // The operator's hands stay where they are in the room, and are not shifted with the robot.
    this.turn = turn;
    const back = shift.clone().negate().applyMatrix4(turn.clone().transpose());
    for (const hand of this.twin.hands) hand.group.position.copy(back);
    this.upright.matrixAutoUpdate = false;
    this.upright.matrix.copy(base.multiply(this.twin.base.matrix.clone().invert()));
    this.upright.matrixWorldNeedsUpdate = true;
    const beside = new THREE.Vector3(0.55, 0.42, 0).applyMatrix4(turn).add(eye);
    beside.y -= 0.12;
    this.board.position.copy(beside);
    this.board.lookAt(eye);
  }

  touch(point) {
    const now = performance.now() / 1000;
    if (now < this.pressed + PRESS_S) return;
    for (const target of this.targets) {
      const near = target.worldToLocal(point.clone());
      if (Math.abs(near.x) < 0.042 && Math.abs(near.y) < 0.021 && Math.abs(near.z) < 0.02) {
        this.pressed = now;
        this.wish(target.name);
        return;
      }
    }
  }
}

function numbers(transform) {
  const { position: p, orientation: q } = transform;
  return [p.x, p.y, p.z, q.x, q.y, q.z, q.w];
}
