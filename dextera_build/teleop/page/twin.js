// The twin: bodies of the simulation, ghosts of retargeted hands, and the operator's own hands as skeletons.

import * as THREE from "./three.module.min.js";

const GHOST = new THREE.MeshStandardMaterial({ color: 0x58a6ff, transparent: true, opacity: 0.35, depthWrite: false });
const HAND_COLOURS = [0xf0883e, 0x4cc38a];

async function texture(bytes) {
  const picture = await createImageBitmap(new Blob([bytes], { type: "image/jpeg" }), { imageOrientation: "flipY" });
  const found = new THREE.Texture(picture);
  found.flipY = false;
  found.colorSpace = THREE.SRGBColorSpace;
  found.needsUpdate = true;
  return found;
}

export class Twin {
  // `world` has the axes of the simulation, z up; whoever shows it places it.
  static async load() {
    const data = await (await fetch("twin")).arrayBuffer();
    const length = new DataView(data).getUint32(0, true);
    const facts = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    const twin = new Twin(facts);
    for (const skin of facts.skins) await twin.add(skin, data, 4 + length);
    twin.ghost();
    return twin;
  }

  constructor(facts) {
    this.facts = facts;
    this.world = new THREE.Group();
    this.bodies = facts.bodies.map((name) => {
      const group = new THREE.Group();
      group.name = name;
      this.world.add(group);
      return group;
    });
    this.base = new THREE.Group();
    this.base.matrix.set(...facts.base);
    this.base.matrixAutoUpdate = false;
    this.world.add(this.base);
    this.hands = HAND_COLOURS.map((colour) => this.skeleton(colour));
  }

  async add(skin, data, start) {
    const part = (place, Kind) => new Kind(data, start + place[0], place[1] / 4);
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(part(skin.vertices, Float32Array), 3));
    shape.setIndex(new THREE.BufferAttribute(part(skin.faces, Uint32Array), 1));
    const opacity = skin.colour[3];
    const look = { side: THREE.DoubleSide, transparent: opacity < 1, opacity };
    let material;
    if (skin.texture) {
      shape.setAttribute("uv", new THREE.BufferAttribute(part(skin.uv, Float32Array), 2));
      look.map = await texture(new Uint8Array(data, start + skin.texture[0], skin.texture[1]));
    } else look.color = new THREE.Color().setRGB(...skin.colour.slice(0, 3), THREE.SRGBColorSpace);
    if (skin.glows) material = new THREE.MeshBasicMaterial(look);
    else {
      // Every corner has the normal of its face: edges stay sharp, and the file needs no normals.
      material = new THREE.MeshStandardMaterial({ ...look, roughness: 0.75, flatShading: true });
    }
    const mesh = new THREE.Mesh(shape, material);
    mesh.frustumCulled = false;
    this.bodies[skin.body].add(mesh);
  }

  ghost() {
    this.ghosts = this.facts.ghosts.map((body) => {
      const group = new THREE.Group();
      for (const mesh of this.bodies[body].children) group.add(new THREE.Mesh(mesh.geometry, GHOST));
      group.visible = false;
      this.base.add(group);
      return group;
    });
  }

  skeleton(colour) {
    const material = new THREE.MeshStandardMaterial({ color: colour, roughness: 0.6 });
    const joints = this.facts.parents.map(() => new THREE.Mesh(new THREE.SphereGeometry(0.006, 10, 8), material));
    const lines = new THREE.BufferGeometry();
    lines.setAttribute("position", new THREE.BufferAttribute(new Float32Array(6 * 24), 3));
    const bones = new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ color: colour }));
    bones.frustumCulled = false;
    const group = new THREE.Group();
    group.add(bones, ...joints);
    group.visible = false;
    this.base.add(group);
    return { group, joints, bones };
  }

  show(facts, numbers) {
    const count = this.bodies.length;
    this.bodies.forEach((body, place) => {
      body.position.fromArray(numbers, 3 * place);
      const q = 3 * count + 4 * place;
      body.quaternion.set(numbers[q + 1], numbers[q + 2], numbers[q + 3], numbers[q]);
      const scale = facts.scales[this.facts.roots[place]] ?? 1;
      body.scale.setScalar(scale);
    });
    this.hands.forEach((hand, side) => this.drawHand(hand, numbers, 7 * count + 75 * side));
    this.ghosts.forEach((ghost, place) => {
      const at = 7 * count + 150 + 7 * place;
      ghost.visible = Number.isFinite(numbers[at]);
      if (!ghost.visible) return;
      ghost.position.fromArray(numbers, at);
      ghost.quaternion.set(numbers[at + 4], numbers[at + 5], numbers[at + 6], numbers[at + 3]);
    });
  }

  drawHand(hand, numbers, at) {
    hand.group.visible = Number.isFinite(numbers[at]);
    if (!hand.group.visible) return;
    hand.joints.forEach((joint, place) => joint.position.fromArray(numbers, at + 3 * place));
    const line = hand.bones.geometry.attributes.position;
    for (let joint = 1; joint < 25; joint += 1) {
      const ends = [this.facts.parents[joint], joint];
      ends.forEach((end, which) => line.array.set(numbers.subarray(at + 3 * end, at + 3 * end + 3), 6 * (joint - 1) + 3 * which));
    }
    line.needsUpdate = true;
  }
}
