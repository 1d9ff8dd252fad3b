// What is drawn on a canvas. Colours come from page.css, so that light and dark are said once.
const DASHES = [[], [7, 4], [2, 3]];

export class Trace {
  constructor(seconds) {
    this.seconds = seconds;
    this.rows = [];
    this.phase = "";
    this.t = -Infinity;
  }

  // Rows come once each, in their order; readings and contact wrenches are never in one plot.
  take(snapshot, earlier) {
    const other = (snapshot.phase === "run") !== (this.phase === "run");
    if (other || snapshot.t < this.t) this.rows = [];
    this.phase = snapshot.phase;
    this.t = snapshot.t;
    for (const rows of [...earlier, snapshot.trace]) {
      for (const row of rows) if (!this.rows.length || row[0] > this.rows[this.rows.length - 1][0]) this.rows.push(row);
    }
    const first = this.rows.findIndex((row) => row[0] > this.t - this.seconds);
    this.rows.splice(0, first < 0 ? this.rows.length : first);
  }
}

function colours() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(`--${name}`).trim();
  return { text: of("text"), soft: of("soft"), line: of("line"), ground: of("card"), accent: of("accent"),
    ok: of("ok"), bad: of("bad"), warn: of("warn"), axes: [of("x"), of("y"), of("z")] };
}

// A canvas as wide as its place, sharp on any screen; drawn in CSS pixels.
function start(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const g = canvas.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, width, height);
  g.font = "13px system-ui, sans-serif";
  g.lineJoin = "round";
  return { g, width, height, c: colours() };
}

function line(g, points, colour, width = 1.5, dash = []) {
  g.beginPath();
  points.forEach(([x, y], i) => (i ? g.lineTo(x, y) : g.moveTo(x, y)));
  g.strokeStyle = colour;
  g.lineWidth = width;
  g.setLineDash(dash);
  g.stroke();
  g.setLineDash([]);
}

function write(g, text, x, y, colour, align = "left") {
  g.fillStyle = colour;
  g.textAlign = align;
  g.fillText(text, x, y);
}

function niceStep(span) {
  const power = 10 ** Math.floor(Math.log10(span / 4));
  return [1, 2, 5, 10].map((k) => k * power).find((step) => span / step <= 5);
}

function hatch(g, x, y, width, height, colour) {
  g.save();
  g.beginPath();
  g.rect(x, y, width, height);
  g.clip();
  for (let at = x - height - ((x - height) % 8); at < x + width; at += 8) line(g, [[at, y + height], [at + height, y]], colour, 1);
  g.restore();
}

// Three lines over the last seconds; what is not valid is hatched and has no line; contact is a bar below.
export function drawPlot(canvas, trace, column, title, now) {
  const { g, width, height, c } = start(canvas);
  const [left, right, top, bottom] = [48, width - 26, 24, height - 24];
  const rows = trace.rows;
  const valid = rows.filter((row) => row[7]);
  let most = column < 4 ? 1 : 0.05;
  let low = -most;
  let high = most;
  for (const row of valid) for (let k = 0; k < 3; k++) {
    const value = row[column + k];
    if (value !== null) { low = Math.min(low, value); high = Math.max(high, value); }
  }
  const pad = 0.06 * (high - low);
  low -= pad;
  high += pad;
  const x = (t) => right - ((now - t) / trace.seconds) * (right - left);
  const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
  write(g, title, left, 14, c.text);
  const step = niceStep(high - low);
  for (let value = Math.ceil(low / step) * step; value <= high; value += step) {
    line(g, [[left, y(value)], [right, y(value)]], c.line, 1);
    write(g, Number(value.toPrecision(6)).toString().replace("-", "−"), left - 6, y(value) + 4, c.soft, "right");
  }
  for (const ago of [10, 5, 0]) write(g, ago ? `−${ago} s` : "now", x(now - ago), height - 6, c.soft, ago === 10 ? "left" : "right");
  stretches(rows, (row) => !row[7], (a, b) => hatch(g, x(a), top, Math.max(x(b) - x(a), 2), bottom - top, c.bad));
  stretches(rows, (row) => row[8] === 1 || row[8] === true, (a, b) => {
    g.fillStyle = c.accent;
    g.fillRect(x(a), bottom - 1, Math.max(x(b) - x(a), 2), 5);
  });
  const silent = rows.length ? now - rows[rows.length - 1][0] : 0;
  if (silent > 0.5) hatch(g, x(now - silent), top, right - x(now - silent), bottom - top, c.bad);
  for (let k = 0; k < 3; k++) {
    let piece = [];
    let before = null;
    const end = () => { if (piece.length > 1) line(g, piece, c.axes[k], 1.6, DASHES[k]); piece = []; };
    for (const row of rows) {
      if (!row[7] || row[column + k] === null || (before !== null && row[0] - before > 0.25)) end();
      if (row[7] && row[column + k] !== null) piece.push([Math.max(x(row[0]), left), y(row[column + k])]);
      before = row[0];
    }
    end();
  }
  labels(g, valid, column, y, right, bottom, c);
}

function stretches(rows, holds, draw) {
  let from = null;
  let to = null;
  for (const row of rows) {
    if (holds(row)) { from = from === null ? row[0] : from; to = row[0]; }
    else if (from !== null) { draw(from, to); from = null; }
  }
  if (from !== null) draw(from, to);
}

// x, y, z at the end of their lines, pushed apart where lines meet.
function labels(g, valid, column, y, right, bottom, c) {
  if (!valid.length) return;
  const last = valid[valid.length - 1];
  const at = [0, 1, 2].map((k) => ({ k, y: y(last[column + k] ?? 0) + 4 })).sort((a, b) => a.y - b.y);
  for (let i = 1; i < 3; i++) at[i].y = Math.max(at[i].y, at[i - 1].y + 13);
  const over = Math.max(0, at[2].y - bottom);
  for (const label of at) write(g, "xyz"[label.k], right + 8, label.y - over, c.axes[label.k]);
}

export const gravityIn = ([x, y, z, w]) => [-2 * (x * z - w * y), -2 * (y * z + w * x), -(1 - 2 * (x * x + y * y))];
const view = { turn: 0.6, tilt: 0.35, latest: null, bound: false };

function projected([x, y, z]) {
  const [ct, st, cv, sv] = [Math.cos(view.turn), Math.sin(view.turn), Math.cos(view.tilt), Math.sin(view.tilt)];
  const [a, b] = [ct * x + st * y, -st * x + ct * y];
  return [a, cv * z + sv * b, sv * z - cv * b]; // right, up, towards the eye
}

export function drawSphere(canvas, poses, orientation) {
  view.latest = [canvas, poses, orientation];
  bindView(canvas);
  const { g, width, height, c } = start(canvas);
  const r = Math.min(width, height) / 2 - 22;
  const place = (v) => { const [a, b, depth] = projected(v); return [width / 2 + r * a, height / 2 - r * b, depth]; };
  g.beginPath();
  g.arc(width / 2, height / 2, r, 0, 7);
  g.strokeStyle = c.soft;
  g.lineWidth = 1.2;
  g.stroke();
  const circle = (of) => Array.from({ length: 61 }, (_, i) => place(of((i * Math.PI) / 30)));
  for (const ring of [(u) => [Math.cos(u), Math.sin(u), 0], (u) => [Math.cos(u), 0, Math.sin(u)], (u) => [0, Math.cos(u), Math.sin(u)]]) {
    line(g, circle(ring), c.line, 1);
  }
  [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, k) => {
    const [ax, ay, depth] = place(axis.map((v) => 1.12 * v));
    write(g, `+${"xyz"[k]}`, ax, ay + 4, depth > 0 ? c.text : c.soft, "center");
  });
  const points = [
    ...poses.targets.map((q, i) => ({ at: place(gravityIn(q)), kind: i ? "planned" : "next" })),
    ...poses.taken.map((pose, i) => ({ at: place(gravityIn(pose.orientation)), kind: pose.doubt ? "doubt" : "taken", label: i + 1 })),
    ...(orientation ? [{ at: place(gravityIn(orientation)), kind: "now" }] : []),
  ].sort((a, b) => a.at[2] - b.at[2]);
  for (const point of points) mark(g, point, c);
}

function mark(g, { at: [x, y, depth], kind, label }, c) {
  g.globalAlpha = depth < -0.05 ? 0.55 : 1;
  g.beginPath();
  if (kind === "now") {
    g.moveTo(x, y - 10);
    g.lineTo(x + 9, y + 7);
    g.lineTo(x - 9, y + 7);
    g.closePath();
    g.fillStyle = c.text;
    g.fill();
    g.strokeStyle = c.ground;
    g.stroke();
  } else {
    if (kind === "doubt") g.rect(x - 8, y - 8, 16, 16);
    else g.arc(x, y, kind === "planned" ? 5 : 9, 0, 7);
    g.fillStyle = kind === "taken" ? c.accent : kind === "doubt" ? c.warn : c.ground;
    g.fill();
    g.strokeStyle = kind === "planned" ? c.soft : kind === "next" ? c.text : c.ground;
    g.lineWidth = kind === "next" ? 2.5 : 1.5;
    g.stroke();
    if (kind === "next") { g.beginPath(); g.arc(x, y, 4, 0, 7); g.stroke(); }
    if (label) { g.font = "bold 11px system-ui, sans-serif"; write(g, String(label), x, y + 4, c.ground, "center"); }
  }
  g.globalAlpha = 1;
}

function bindView(canvas) {
  if (view.bound) return;
  view.bound = true;
  const turn = (by, up) => {
    view.turn += by;
    view.tilt = Math.max(-1.5, Math.min(1.5, view.tilt + up));
    drawSphere(...view.latest);
  };
  const keys = { ArrowLeft: [-0.2, 0], ArrowRight: [0.2, 0], ArrowUp: [0, 0.2], ArrowDown: [0, -0.2] };
  canvas.addEventListener("keydown", (event) => { if (event.key in keys) { event.preventDefault(); turn(...keys[event.key]); } });
  canvas.addEventListener("pointermove", (event) => { if (event.buttons) turn(event.movementX / 120, event.movementY / 120); });
}

// The std of the contact force after each pose, on a scale of decades, and the std that is wanted.
export function drawConvergence(canvas, poses) {
  const { g, width, height, c } = start(canvas);
  const [left, right, top, bottom] = [60, width - 12, 22, height - 26];
  const known = poses.history.map((std, i) => [i + 1, std]).filter(([, std]) => std > 0);
  const stds = [poses.wanted, ...known.map(([, std]) => std)];
  const low = Math.floor(Math.log10(Math.min(...stds) / 1.5));
  const high = Math.max(low + 1, Math.ceil(Math.log10(1.2 * Math.max(...stds))));
  const most = Math.max(8, poses.history.length + 1);
  const x = (n) => left + ((n - 1) / (most - 1)) * (right - left);
  const y = (std) => bottom - ((Math.log10(std) - low) / (high - low)) * (bottom - top);
  write(g, "std of the contact force, N", 6, 13, c.text);
  write(g, "poses", 6, height - 8, c.text);
  for (let power = low; power <= high; power++) {
    line(g, [[left, y(10 ** power)], [right, y(10 ** power)]], c.line, 1);
    write(g, String(Number((10 ** power).toPrecision(2))), left - 6, y(10 ** power) + 4, c.soft, "right");
  }
  for (let n = 1; n <= most; n += most > 20 ? 5 : most > 9 ? 2 : 1) write(g, String(n), x(n), height - 8, c.soft, "center");
  line(g, [[left, y(poses.wanted)], [right, y(poses.wanted)]], c.ok, 2, [6, 4]);
  write(g, "wanted", right, y(poses.wanted) - 5, c.ok, "right");
  line(g, known.map(([n, std]) => [x(n), y(std)]), c.accent, 2);
  for (const [n, std] of known) { g.beginPath(); g.arc(x(n), y(std), 3.5, 0, 7); g.fillStyle = c.accent; g.fill(); }
}

// The wrist from the side: flange, sensor and tool, and where to press.
export function drawPush(canvas, step) {
  const { g, width, c } = start(canvas);
  const middle = width / 2;
  const box = (x, y, w, h, label) => {
    g.strokeStyle = c.soft;
    g.lineWidth = 1.5;
    g.strokeRect(x - w / 2, y, w, h);
    write(g, label, x, y + h / 2 + 5, c.text, "center");
  };
  box(middle, 8, 110, 34, "flange");
  box(middle, 42, 84, 30, "sensor");
  box(middle, 72, 56, 74, "tool");
  if (!step || !step.toward) return;
  const colour = c.accent;
  const arrow = (x0, y0, x1, y1) => {
    const angle = Math.atan2(y1 - y0, x1 - x0);
    line(g, [[x0, y0], [x1, y1]], colour, 4);
    const barb = (a) => [x1 + 14 * Math.cos(angle + a), y1 + 14 * Math.sin(angle + a)];
    line(g, [barb(-2.6), [x1, y1], barb(2.6)], colour, 4);
  };
  if (step.toward === "down") {
    arrow(middle + 44, 92, middle + 44, 172);
    write(g, "down", middle + 56, 136, colour);
  } else {
    arrow(middle - 120, 122, middle - 34, 122);
    write(g, `towards the flange's ${step.toward}`, middle, 170, colour, "center");
  }
}
