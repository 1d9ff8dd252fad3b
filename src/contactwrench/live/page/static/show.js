// What a snapshot looks like in words and numbers. Texts are only ever set as text, never as markup.
import { drawConvergence, drawPlot, drawPush, drawSphere } from "./draw.js";

const byId = (id) => document.getElementById(id);
const STEPS = { connect: "Connect", push: "Push test", poses: "Poses", fit: "Fit", verify: "Verify", run: "Run" };
const AXES = ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"];
const CHECKS = 2;
const USUAL = {
  connect: ["next"], push: ["back", "skip", "next"], poses: ["back", "skip", "capture", "next"],
  fit: ["back", "save", "next"], verify: ["back", "skip", "capture", "save", "next"], run: ["zero", "record", "back"],
};
const STATES = { streaming: "● sending", connecting: "◌ connecting", silent: "▲ silent", down: "✕ not connected" };
const HELP = {
  silent: "Check its power and its cable. Check that no other program has taken its connection.",
  down: "Check its power, its cable and its address. The program tries again by itself.",
  connecting: "",
};
const LAMPS = { error: "▨", contact: "●", ok: "○", note: "◌" };
const LEVELS = { note: "note", warning: "▲ warning", error: "✕ error", weak: "▲ weak", refused: "✕ refused" };

export const degrees = (rad) => Math.round((rad * 180) / Math.PI);
export function num(value, digits) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return value.toFixed(digits).replace("-", "−");
}
const short = (value) => (value > 0 ? value.toFixed(Math.max(0, 1 - Math.floor(Math.log10(value)))) : num(value, 1));
const sentence = (text) => (/^[a-z0-9]+:\/\//.test(text) ? text : text.charAt(0).toUpperCase() + text.slice(1)); // an address stays as it is
const unitOf = (axis) => (axis < 3 ? "N" : "N m");
const digitsOf = (axis) => (axis < 3 ? 3 : 4);
const clock = (t) => new Date(1000 * t).toLocaleTimeString([], { hour12: false });

function set(id, text) {
  const element = typeof id === "string" ? byId(id) : id;
  if (element.textContent !== text) element.textContent = text;
  return element;
}

function level(id, value) {
  const element = typeof id === "string" ? byId(id) : id;
  if (element.dataset.level !== value) element.dataset.level = value;
}

// As many children as items, each kept while it has one, so that a focus stays where it is.
function list(id, items, make, fill) {
  const parent = typeof id === "string" ? byId(id) : id;
  while (parent.children.length > items.length) parent.lastElementChild.remove();
  while (parent.children.length < items.length) parent.append(make(parent.children.length));
  items.forEach((item, i) => fill(parent.children[i], item, i));
}

function make(tag, ...classes) {
  const element = document.createElement(tag);
  element.append(...classes.map((name) => Object.assign(document.createElement("span"), { className: name })));
  return element;
}

// `why` the page has no news, or empty. The age stands outside the alert, which is read out when it changes.
export function stale(why, age) {
  document.body.classList.toggle("old", Boolean(why));
  level("link", why ? "error" : "ok");
  set("link", !why ? "● live" : age === null ? "✕ no news" : `✕ no news for ${Math.round(age)} s`);
  byId("banner").hidden = !why;
  set("banner", why && age !== null ? `${why} What you see below is old.` : why);
}

export function show(now, trace, ask) {
  const fault = faultOf(now);
  showPhase(now);
  showInstruction(now, fault);
  showActions(now, ask);
  showDevices(now);
  showOutputs(now);
  showEvents(now);
  if (now.phase === "push") showPush(now);
  if (now.poses && (now.phase === "poses" || now.phase === "verify")) showPoses(now, ask);
  if (now.phase === "verify") showChecks(now);
  if (now.phase === "fit" || now.phase === "verify") showFit(now);
  if (!byId("wrench").hidden) showWrench(now, fault, trace);
  if (now.phase === "run") showRun(now);
}

// What makes the numbers old or unknown, whatever the session says of the last one.
function faultOf(now) {
  const bad = now.devices.filter((device) => device.state === "silent" || device.state === "down");
  const text = bad.map((device) => `The ${device.role} ${device.state === "silent" ? "is silent" : "is not connected"}.`);
  const detail = bad.map((device) => `${device.uri}: ${[device.text, HELP[device.state]].filter(Boolean).join(". ")}`);
  const needed = now.phase === "run" ? bad.length : bad.some((device) => device.role.includes("sensor"));
  return { text: text.join(" "), detail: detail.join(" "), invalid: needed ? text.join(" ") : "" };
}

function showPhase(now) {
  if (document.body.dataset.phase !== now.phase) {
    const inside = document.activeElement && document.activeElement.closest("main");
    document.body.dataset.phase = now.phase;
    for (const part of document.querySelectorAll("[data-in]")) part.hidden = !part.dataset.in.split(" ").includes(now.phase);
    if (inside) byId("instruction").focus();
  }
  const names = Object.keys(STEPS);
  const at = names.indexOf(now.phase);
  list("steps", names, () => document.createElement("li"), (item, name, i) => {
    set(item, `${i < at ? "✓" : i + 1} ${STEPS[name]}`);
    if (i === at) item.setAttribute("aria-current", "step");
    else item.removeAttribute("aria-current");
  });
}

const INSTRUCTIONS = {
  connect(now) {
    const waiting = now.devices.find((device) => device.state === "connecting");
    if (!now.devices.length) return ["No device is given.", "Start the program with --sensor and --robot."];
    const before = now.events.findLast((event) => event.kind === "compiling" || event.kind === "waiting");
    const soon = before?.kind === "compiling" ? "The session begins soon." : "Nobody sends yet.";
    if (waiting && before) return [soon, before.text];
    if (waiting) return [`Connecting to the ${waiting.role}.`, waiting.uri];
    if (!now.still) return ["Let the arm stand still.", now.moving];
    return ["The devices send. Go on.", "Look at the readings: at rest they should stand still too."];
  },
  push(now) {
    const step = now.push.find((each) => !each.seen);
    if (!step) return ["The push test is done.", ""];
    if (step.force >= step.needed) return [step.ask, `${num(step.force, 1)} N: enough. Let go after a second.`];
    return [step.ask, `${num(step.force, 1)} N so far, ${num(step.needed, 0)} N are needed.`];
  },
  poses(now) {
    const poses = now.poses;
    if (!poses) return ["Move the arm to a first pose.", ""];
    if (poses.progress > 0) return ["Hold still. A pose is being taken.", `${Math.round(100 * poses.progress)} %`];
    const turn = poses.turn === null ? "" : `${degrees(poses.turn)}° to go. `;
    const text = poses.enough ? "Enough poses. Go on, or take more." : "Turn the wrist to the next pose.";
    return [text, turn + sentence(poses.waiting)];
  },
  fit(now) {
    if (!now.fit) return ["Working out the calibration.", ""];
    if (now.fit.refusal) return ["There is no calibration yet.", now.fit.refusal];
    return [`The calibration is ${now.fit.verdict}.`, now.saved ? "" : "Save it, or check it on new poses first."];
  },
  verify(now) {
    const poses = now.poses;
    if (now.verified) {
      const [verdict, reason] = now.verified.split(/: (.*)/s);
      return [`The check ${verdict}.`, sentence(reason || ""), verdict === "passed" ? "ok" : "error"];
    }
    if (poses && poses.progress > 0) return ["Hold still. A check is being taken.", `${Math.round(100 * poses.progress)} %`];
    return ["Move the arm to a new pose and let go.", `${now.checks.length} of ${CHECKS} checks done. ${poses ? sentence(poses.waiting) : ""}`];
  },
  run(now) {
    const state = contactState(now, "");
    const inertia = !now.contact || (now.running && now.running.inertia) ? "" : NOT_SUBTRACTED;
    return [`${LAMPS[state.level]} ${state.text}`, state.reason || inertia, state.level];
  },
};
const NOT_SUBTRACTED = "The tool's inertia is not subtracted: while the arm accelerates, it reads as contact.";

function showInstruction(now, fault) {
  const stands = !fault.text || now.phase === "fit";
  const [text, detail, state] = stands ? INSTRUCTIONS[now.phase](now) : [`▨ ${fault.text}`, fault.detail, "error"];
  set("instruction", sentence(text));
  set("detail", sentence(detail));
  level("now", state || "");
}

function labelOf(what, now) {
  const names = Object.keys(STEPS);
  const next = STEPS[names[names.indexOf(now.phase) + 1]] || "";
  const back = now.phase === "run" ? "Calibrate again" : "Back";
  const record = now.recording ? "Stop recording" : "Record";
  return { back, record, retake: "Press again from the start", skip: "Skip", capture: "Take this pose", save: "Save", zero: "Zero", next: `Next: ${next.toLowerCase()}` }[what];
}

// While no device sends there is nothing to go on with.
const mayGoOn = (now) => now.phase !== "connect" || now.devices.some((device) => device.state === "streaming");

function showActions(now, ask) {
  const wanted = [...USUAL[now.phase], ...now.commands.filter((what) => !USUAL[now.phase].includes(what)
    && (what !== "retake" || now.phase === "push"))];
  const group = byId("actions");
  for (const old of [...group.children]) {
    if (!wanted.includes(old.dataset.do)) {
      if (old === document.activeElement) byId("instruction").focus();
      old.remove();
    }
  }
  wanted.forEach((what) => {
    let button = group.querySelector(`[data-do=${what}]`);
    if (!button) {
      button = Object.assign(document.createElement("button"), { type: "button" });
      button.dataset.do = what;
      button.addEventListener("click", () => { if (button.getAttribute("aria-disabled") !== "true") ask(what); });
    }
    if (group.children[wanted.indexOf(what)] !== button) group.insertBefore(button, group.children[wanted.indexOf(what)] || null);
    set(button, labelOf(what, now));
    button.setAttribute("aria-disabled", String(!now.commands.includes(what) || (what === "next" && !mayGoOn(now))));
  });
}

function showDevices(now) {
  list("devices", now.devices, () => make("li", "uri", "tag", "name", "rate", "counts", "problem"), (item, device) => {
    const [uri, tag, name, rate, counts, problem] = item.children;
    set(uri, `${device.role}: ${device.uri}`);
    set(tag, STATES[device.state] || device.state);
    level(tag, { streaming: "ok", connecting: "note" }[device.state] || "error");
    set(name, device.name);
    const asked = device.asked === null ? "" : ` of ${num(device.asked, 0)} Hz`;
    const jitter = device.jitter === null ? "" : `, late by ${num(1000 * device.jitter, 1)} ms`;
    set(rate, device.rate === null ? "rate not known yet" : `${num(device.rate, 1)} Hz${asked}${jitter}`);
    level(rate, device.rate !== null && device.asked && device.rate < 0.9 * device.asked ? "warning" : "note");
    const age = device.age > 1 ? `, the last ${num(device.age, 0)} s ago` : "";
    set(counts, `${device.samples} samples${age}; ${device.lost} lost, ${device.repeated} repeated, ${device.wrong} not used`);
    level(counts, device.lost + device.wrong > 0.001 * device.samples ? "warning" : "note");
    set(problem, [device.text, HELP[device.state] || ""].filter(Boolean).join(". "));
  });
}

function showOutputs(now) {
  const recording = now.recording ? [{ uri: `● recording to ${now.recording}`, written: null, dropped: 0, error: "" }] : [];
  const outputs = [...recording, ...now.outputs];
  byId("outputs-section").hidden = outputs.length === 0;
  list("outputs", outputs, () => make("li", "uri", "rate", "problem"), (item, output) => {
    const [uri, rate, problem] = item.children;
    set(uri, output.uri);
    set(rate, output.written === null ? "" : `${output.written} rows written, ${output.dropped} dropped`);
    level(rate, output.dropped ? "warning" : "note");
    set(problem, output.error);
  });
}

// What says the same again is one line: the last time, and how often.
function folded(events) {
  const lines = new Map();
  for (const event of [...events].reverse()) {
    const key = JSON.stringify([event.kind, event.text, event.device]);
    if (lines.has(key)) lines.get(key).times += 1;
    else lines.set(key, { ...event, times: 1 });
  }
  return [...lines.values()];
}

function showEvents(now) {
  list("events", folded(now.events), () => make("li", "time", "tag", "what"), (item, event) => {
    const [time, tag, what] = item.children;
    set(time, clock(event.t));
    set(tag, LEVELS[event.severity] || event.severity);
    level(tag, event.severity);
    const often = event.times > 1 ? ` (${event.times} times, this was the last)` : "";
    set(what, (event.device ? `${event.text} (${event.device})` : event.text) + often);
  });
}

function showPush(now) {
  const step = now.push.find((each) => !each.seen) || null;
  drawPush(byId("sketch"), step);
  byId("sketch").setAttribute("aria-label", step ? `${step.ask}: ${num(step.force, 0)} of ${num(step.needed, 0)} N` : "done");
  list("pushes", now.push, () => {
    const item = make("li", "what", "rate");
    item.append(document.createElement("progress"));
    return item;
  }, (item, push) => {
    const [what, rate, bar] = item.children;
    set(what, `${push.seen ? "✓" : push === step ? "▶" : "○"} ${push.ask}`);
    set(rate, push.seen || `${num(push.force, 1)} N of ${num(push.needed, 0)} N`);
    bar.hidden = Boolean(push.seen);
    bar.max = push.needed;
    bar.value = Math.min(push.force, push.needed);
    bar.setAttribute("aria-label", push.ask);
  });
}

function showPoses(now, ask) {
  const poses = now.poses;
  drawSphere(byId("sphere"), poses, now.orientation);
  byId("sphere").setAttribute("aria-label", `${poses.taken.length} poses taken, ${poses.targets.length} planned`);
  const done = `${Math.round(100 * poses.progress)} %`;
  byId("ring").style.setProperty("--done", done.replace(" ", ""));
  byId("ring").setAttribute("aria-label", `pose ${done} taken`);
  set(byId("ring").firstElementChild, done);
  set("capture-text", `${poses.taken.length === 1 ? "1 pose is" : `${poses.taken.length} poses are`} taken${poses.taken.length < poses.fewest ? ` of at least ${poses.fewest}` : ""}. ${now.verified ? "Both checks are done." : poses.progress > 0 ? "Hold still." : sentence(poses.waiting)}`);
  drawConvergence(byId("convergence"), poses);
  const std = poses.std_force === null ? "Not known yet: more poses are needed."
    : `± ${short(poses.std_force)} N and ± ${short(poses.std_torque)} N m after ${poses.taken.length} poses.`;
  set("convergence-text", `How well the contact wrench is known: ${std} Wanted: ± ${short(poses.wanted)} N.`);
  byId("convergence").setAttribute("aria-label", byId("convergence-text").textContent);
  list("taken", poses.taken, (i) => {
    const item = make("li", "what", "problem");
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: "Take again" });
    button.setAttribute("aria-label", `Take pose ${i + 1} again`);
    button.addEventListener("click", () => { if (button.getAttribute("aria-disabled") !== "true") ask("retake", i); });
    item.append(button);
    return item;
  }, (item, pose, i) => {
    const [what, problem, button] = item.children;
    set(what, `${pose.doubt ? "▲" : "✓"} pose ${i + 1}`);
    set(problem, pose.doubt);
    item.classList.toggle("doubt", Boolean(pose.doubt));
    button.setAttribute("aria-disabled", String(!now.commands.includes("retake")));
  });
}

function showChecks(now) {
  const rows = [...now.checks, ...Array(Math.max(0, CHECKS - now.checks.length)).fill(null)];
  list("checks", rows, () => make("li", "what", "tag"), (item, check, i) => {
    const [what, tag] = item.children;
    set(what, check ? `Pose ${i + 1}: ${short(check.force)} N and ${short(check.torque)} N m are left.` : `Pose ${i + 1}`);
    set(tag, check ? (check.passed ? "✓ passed" : "✕ failed") : "○ to come");
    level(tag, check ? (check.passed ? "ok" : "error") : "note");
  });
  set("verified", sentence(now.verified));
}

function showFit(now) {
  const fit = now.fit;
  if (!fit) return;
  set("verdict", fit.refusal ? "✕ none" : `${fit.verdict === "good" ? "✓" : "▲"} ${fit.verdict}`);
  byId("table").hidden = fit.parameters.length === 0;
  level("verdict", fit.refusal ? "error" : fit.verdict === "good" ? "ok" : "warning");
  const expected = fit.expected_force === null ? ""
    : `Expect contact forces within ± ${short(fit.expected_force)} N and torques within ± ${short(fit.expected_torque)} N m.`;
  list("expected", [expected, fit.sign, fit.delay && `Delay: ${fit.delay}`].filter(Boolean), () => make("li"), (item, text) => set(item, sentence(text)));
  list("findings", fit.findings, () => make("li", "tag", "what"), (item, [severity, text]) => {
    level(item.children[0], severity);
    set(item.children[0], LEVELS[severity] || severity);
    set(item.children[1], text);
  });
  list("parameters", fit.parameters, () => {
    const row = document.createElement("tr");
    row.append(Object.assign(document.createElement("th"), { scope: "row" }), ...[0, 1, 2].map(() => document.createElement("td")));
    return row;
  }, (row, parameter) => {
    [parameter.name, parameter.value, parameter.std, parameter.unit].forEach((text, i) => set(row.children[i], text));
  });
  set("saved", now.saved);
}

function contactState(now, fault) {
  const contact = now.contact;
  if (!contact) return { level: "note", text: "No contact wrench yet.", reason: fault };
  if (fault || !contact.valid) return { level: "error", text: "Not valid.", reason: fault || contact.reason };
  if (contact.contact === null) return { level: "note", text: "Contact cannot be told.", reason: contact.reason };
  return contact.contact ? { level: "contact", text: "Contact.", reason: contact.reason }
    : { level: "ok", text: "No contact.", reason: contact.reason };
}

function restState(now, fault) {
  if (fault || !now.reading) return { level: "error", text: "Not valid.", reason: fault || "No reading has come yet." };
  return now.still ? { level: "ok", text: "At rest.", reason: "" } : { level: "note", text: "Not at rest.", reason: sentence(now.moving) };
}

function showWrench(now, fault, trace) {
  const running = now.phase === "run";
  set("wrench-title", running ? "Contact wrench" : "Readings");
  const state = running ? contactState(now, fault.invalid) : restState(now, fault.invalid);
  set("lamp", `${LAMPS[state.level]} ${state.text}`);
  level("lamp", state.level);
  set("invalid", state.reason);
  const values = running ? now.contact && now.contact.wrench : now.reading;
  const stds = running ? now.contact && now.contact.std : now.noise;
  showSix("numbers", values, stds, state.level === "error");
  const what = running ? "Contact" : "Reading:";
  drawPlot(byId("force"), trace, 1, `${what} force, N`, now.t);
  drawPlot(byId("torque"), trace, 4, `${what} torque, N m`, now.t);
  byId("force").setAttribute("aria-label", `${what} force, last 10 s; its numbers stand below`);
  byId("torque").setAttribute("aria-label", `${what} torque, last 10 s; its numbers stand below`);
}

function showSix(id, values, stds, invalid) {
  list(id, AXES, () => {
    const pair = document.createElement("div");
    pair.append(document.createElement("dt"), make("dd", "value", "std"));
    return pair;
  }, (pair, axis, i) => {
    const [value, std] = pair.children[1].children;
    set(pair.children[0], `${axis}, ${unitOf(i)}`);
    pair.classList.toggle("invalid", Boolean(invalid));
    set(value, num(values && values[i], digitsOf(i)));
    set(std, stds ? `± ${num(stds[i], digitsOf(i))}` : "");
  });
}

function showRun(now) {
  const running = now.running;
  if (!running) return;
  set("run-text", `Calibration ${running.calibration}.${running.inertia ? " The tool's inertia is subtracted." : ""} ${running.invalid} readings were not valid.`
    + (now.recording ? ` Recording to ${now.recording}.` : ""));
  const contacts = running.contacts.slice(-10).reverse();
  list("contacts", contacts.length ? contacts : [null], () => make("li", "what"), (item, contact) => set(item.children[0], contact
    ? `${clock(contact[0])}: ${num(contact[1], 2)} s, at most ${num(contact[2], 1)} N` : "none yet"));
  showSix("drift", running.drift, null, false);
}
