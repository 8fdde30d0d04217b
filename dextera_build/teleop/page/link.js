// The connection to the session: hands go out, states come in, and delays are measured.

const HEAD = 56;
const UNTRACKED = { tracking: [0, 0], clutch: [0, 0], pinch: [0, 0], head: null, wrists: null, closed: [0, 0], joints: null, base: false };
const MOST = 100;

export class Link {
  constructor(device, onState, onWord) {
    this.onState = onState;
    this.onWord = onWord;
    this.device = device;
    this.number = 0;
    this.sentAt = new Map();
    this.way = [];
    this.trip = [];
    this.lastWay = null;
    this.lastTrip = null;
    this.used = null;
    this.ended = false;
    this.connect();
    setInterval(() => this.measure(), 500);
  }

  connect() {
    const address = new URL("socket", location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => { this.onWord("connected"); this.send({ device: this.device }); };
    socket.onmessage = (event) => this.read(event.data);
    socket.onclose = (event) => {
      if (this.ended) return;
      const words = event.reason || "the connection was lost";
      this.onWord(words + (event.code === 4001 ? "" : "; connecting again"), true);
      if (event.code !== 4001) setTimeout(() => this.connect(), 1000);
    };
    this.socket = socket;
  }

  // What the operator holds or wears.
  name(device) {
    this.device = device;
    this.send({ device });
  }

  get open() { return this.socket.readyState === WebSocket.OPEN; }

  send(command) { if (this.open) this.socket.send(JSON.stringify(command)); }

  // Hands of one moment: joints of both hands (2 x 25 x 7), or wrists (2 x 7) and how far each is closed.
  hands(changes) {
    const hands = { ...UNTRACKED, ...changes };
    // Messages that wait here would be old when they arrive.
    if (!this.open || this.socket.bufferedAmount > 4096) return;
    const joints = hands.joints !== null;
    const data = new ArrayBuffer(HEAD + 4 * (joints ? 350 : 16));
    const view = new DataView(data);
    const now = performance.now();
    this.number += 1;
    view.setUint32(0, this.number, true);
    view.setUint8(4, joints ? 0 : 1);
    view.setUint8(5, joints ? 25 : 0);
    view.setUint16(6, hands.base ? 1 : 0, true);
    view.setFloat64(8, now, true);
    for (const hand of [0, 1]) {
      view.setUint8(16 + hand, hands.tracking[hand]);
      view.setUint8(18 + hand, hands.clutch[hand] ? 1 : 0);
      view.setFloat32(20 + 4 * hand, hands.pinch[hand], true);
    }
    for (let place = 0; place < 7; place += 1) view.setFloat32(28 + 4 * place, hands.head ? hands.head[place] : NaN, true);
    const values = new Float32Array(data, HEAD);
    if (joints) values.set(hands.joints);
    else for (const hand of [0, 1]) values.set([...hands.wrists[hand], hands.closed[hand]], 8 * hand);
    this.socket.send(data);
    this.sentAt.set(this.number, now);
    this.sentAt.delete(this.number - 600);
  }

  read(data) {
    if (typeof data === "string") {
      const answer = JSON.parse(data);
      if ("pong" in answer) {
        this.lastTrip = performance.now() - answer.pong;
        this.trip.push(this.lastTrip);
      } else if (answer.refused) this.onWord(answer.refused, true);
      return;
    }
    const length = new DataView(data).getUint32(0, true);
    const facts = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    const now = performance.now();
    this.ended = facts.phase === "ended";
    if (facts.used !== null && facts.used !== this.used && this.sentAt.has(facts.used)) {
      this.used = facts.used;
      this.lastWay = now - this.sentAt.get(facts.used);
      if (this.way.length < MOST) this.way.push(this.lastWay);
    }
    this.onState(facts, new Float32Array(data, 4 + length));
  }

  measure() {
    if (this.way.length || this.trip.length) this.send({ way: this.way, trip: this.trip });
    this.way = [];
    this.trip = [];
    this.send({ ping: performance.now() });
  }
}
