// What the operator reads: of the page, and of the same facts on a board within the headset.

const by = (name) => document.getElementById(name);
const ms = (value) => (value === null ? "not measured" : `${value.toFixed(0)} ms`);

export function words(facts, link, note) {
  const taking = facts.phase === "taking";
  const missing = ["left", "right"].filter((side, hand) => facts.tracked[hand] && facts.measured[hand] < 1);
  const share = Math.min(...facts.measured.filter((_, hand) => facts.tracked[hand]), 1);
  let told = facts.told;
  if (facts.phase === "ended") told = `${told && `${told}; `}the session has ended, and this page can be closed`;
  else if (facts.silent) told = "nothing arrives from this device: the robot holds";
  else if (taking && Object.values(facts.held).some(Boolean)) told = "held: hand lost, clutch open, or a jump";
  else if (facts.phase === "ready" && missing.length) told = `hold the ${missing.join(" and the ")} hand open: ${Math.round(100 * share)} %`;
  else if (!taking && !told) told = "ready: press Start";
  else if (taking) told = "recording";
  else if (facts.phase === "waiting") told = "the take begins when a hand moves the robot";
  if (note) told = note;
  const hand = (side) => {
    if (!facts.tracked[side]) return ["not seen", "bad"];
    if (facts.measured[side] < 1) return ["not measured, moves nothing", "bad"];
    return facts.clutch[side] ? ["moves the robot", "good"] : ["clutch open", ""];
  };
  return {
    takes: facts.kept, most: facts.takes, told,
    kind: /not kept|stopped|lost|not written|refused|nothing arrives/.test(told) ? "bad" : /kept|recording/.test(told) ? "good" : "",
    taking, passed: facts.seconds / facts.limit, seconds: facts.seconds, limit: facts.limit,
    left: hand(0), right: hand(1),
    lag: [`${facts.lag_mm.toFixed(0)} mm`, facts.lag_mm > 12 ? "bad" : ""],
    limits: [facts.limits.length ? facts.limits.join(", ") : "none", facts.limits.length ? "bad" : ""],
    delay: [facts.own_ms ? `${link.lastWay === null ? "" : `${ms(link.lastWay)}, `}own ${facts.own_ms[0].toFixed(0)} ms` : "not measured", ""],
    trip: [ms(link.lastTrip), link.lastTrip > 50 ? "bad" : ""],
  };
}

export function show(found) {
  by("takes").innerHTML = "";
  const done = document.createElement("b");
  done.textContent = String(found.takes);
  by("takes").append(done, ` of ${found.most} takes`);
  by("told").textContent = found.told;
  by("told").className = found.kind;
  by("clock").hidden = !found.taking;
  by("passed").style.width = `${Math.min(100, 100 * found.passed)}%`;
  for (const name of ["left", "right", "lag", "limits", "delay", "trip"]) {
    by(name).textContent = found[name][0];
    by(name).className = found[name][1];
  }
}

export function board(context, title, found) {
  const { width, height } = context.canvas;
  context.fillStyle = "rgba(22, 27, 34, 0.95)";
  context.fillRect(0, 0, width, height);
  const colours = { good: "#4cc38a", bad: "#f0883e", "": "#e6edf3" };
  const line = (text, y, size, colour) => {
    context.fillStyle = colour;
    context.font = `${size}px system-ui, sans-serif`;
    context.fillText(text, 24, y, width - 48);
  };
  line(`${title} · ${found.takes} of ${found.most} takes`, 48, 32, "#e6edf3");
  line(found.told, 100, 30, colours[found.kind]);
  const rows = [["left hand", found.left], ["right hand", found.right], ["behind its target", found.lag],
    ["limits met", found.limits], ["delay", found.delay], ["round trip", found.trip],
    ["time", [`${found.seconds.toFixed(1)} of ${found.limit.toFixed(0)} s`, ""]]];
  rows.forEach(([name, [text, kind]], place) => {
    line(name, 150 + 38 * place, 26, "#9aa7b4");
    context.fillStyle = colours[kind];
    context.textAlign = "right";
    context.fillText(text, width - 24, 150 + 38 * place, width - 300);
    context.textAlign = "left";
  });
}
