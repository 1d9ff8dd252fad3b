// The connection: snapshots in, commands out. What is shown is in show.js, what is drawn in draw.js.
import { show, stale } from "./show.js";
import { Trace } from "./draw.js";

const OLD = 1500; // ms without a snapshot, after which what is shown is marked as old
const byId = (id) => document.getElementById(id);
const trace = new Trace(10);
let socket = null;
let last = null;
let lastAt = 0;
let wait = 250;
let lost = "";

if (location.search.includes("token=")) history.replaceState(null, "", location.pathname);

function connect() {
  socket = new WebSocket(`ws://${location.host}/live`);
  socket.onopen = () => { send({ kind: "ready" }); };
  socket.onmessage = (event) => received(JSON.parse(event.data));
  socket.onclose = (event) => {
    lost = event.reason || "The program has ended, or does not answer.";
    setTimeout(connect, wait);
    wait = Math.min(2 * wait, 5000);
    mark();
  };
}

function send(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function received(message) {
  if ("lab" in message) {
    byId("lab").hidden = !message.lab;
  } else if ("notice" in message) {
    byId("notice").textContent = message.notice;
  } else {
    send({ kind: "ready" });
    wait = 250;
    lost = "";
    lastAt = performance.now();
    trace.take(message.snapshot, message.earlier);
    last = message.snapshot;
    mark();
  }
}

function mark() {
  const age = performance.now() - lastAt;
  stale(lost || (age > OLD ? "The program says nothing." : ""), last ? age / 1000 : null);
}

function ask(what, pose) {
  byId("notice").textContent = "";
  send(pose === undefined ? { kind: "ask", do: what } : { kind: "ask", do: what, pose });
}

function hold(button, press) {
  let held = false;
  const down = () => { if (!held) { held = true; button.setAttribute("aria-pressed", "true"); send({ kind: "lab", do: press }); } };
  const up = () => { if (held) { held = false; button.setAttribute("aria-pressed", "false"); send({ kind: "lab", do: "release" }); } };
  const isKey = (event) => event.key === " " || event.key === "Enter";
  button.setAttribute("aria-pressed", "false");
  button.addEventListener("pointerdown", (event) => { button.setPointerCapture(event.pointerId); down(); });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) button.addEventListener(end, up);
  button.addEventListener("keydown", (event) => { if (isKey(event)) { event.preventDefault(); if (!event.repeat) down(); } });
  button.addEventListener("keyup", (event) => { if (isKey(event)) { event.preventDefault(); up(); } });
  button.addEventListener("contextmenu", (event) => event.preventDefault());
  window.addEventListener("blur", up);
}

function buildLab() {
  const pushes = { press_down: "Press down (hold)", press_x: "Press +x (hold)", push_tool: "Push the tool (hold)" };
  const clicks = { release: "Release", next_pose: "Next pose" };
  for (const [what, label] of Object.entries({ ...pushes, ...clicks })) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = label;
    if (what in pushes) hold(button, what);
    else button.addEventListener("click", () => send({ kind: "lab", do: what }));
    byId("lab-buttons").append(button);
  }
}

// Drawn when something is new, and only as often as the screen asks; twice a second for who wants no motion.
const calm = matchMedia("(prefers-reduced-motion: reduce)");
let shown = null;
let shownAt = 0;
function frame(at) {
  if (last !== shown && (!calm.matches || at - shownAt > 500)) {
    shown = last;
    shownAt = at;
    show(last, trace, ask);
  }
  requestAnimationFrame(frame);
}

buildLab();
connect();
setInterval(mark, 250);
requestAnimationFrame(frame);
