// The live window: brings the parts together, and keeps the state that the server draws.
import { Controls } from "./controls.js";
import { Editor } from "./editor.js";
import { Link } from "./link.js";
import { Messages } from "./messages.js";
import { Picture } from "./canvas.js";

const $ = (id) => document.getElementById(id);
const TYPING = "input:not([type=range]):not([type=checkbox]), textarea, select, .cm-editor";

const state = { sets: {}, camera: null, pose: null, backend: null, exposure: null, channel: "color", moment: null };
let timeline = null, playing = null;

const link = new Link(() => ({ state: { ...state }, texts: editor.unsaved() }));
const editor = new Editor(link);
let pending = null;

// Merge into the state, and send it: the first change at once, those that follow it closely together.
function change(given) {
  for (const [name, value] of Object.entries(given)) {
    if (name !== "sets") state[name] = value;
    else for (const [param, text] of Object.entries(value)) {
      if (text === null) delete state.sets[param];
      else state.sets[param] = text;
    }
  }
  pending = { ...pending, ...given, ...(given.sets ? { sets: { ...pending?.sets, ...given.sets } } : {}) };
  if (!change.waits) flush();
  show();
}

function flush() {
  change.waits = false;
  if (!pending || !Object.keys(pending).length || !link.send({ type: "change", state: pending })) return;
  pending = null;
  change.waits = true;
  setTimeout(flush, 12);
}

const picture = new Picture(link, change);
const controls = new Controls(link, change);
const messages = new Messages(link, editor, picture);

// --- the server's messages ---

link.on("status", (status) => {
  const root = $("link");
  root.className = status;
  root.textContent = status === "open" ? "live" : "reconnecting";
  if (status === "open") flush();
});
link.on("state", (message) => {
  if (message.from === link.page && message.from !== 0) return;
  Object.assign(state, message.state);
  controls.restore(state.sets);
  show();
});
link.on("scene", (scene) => {
  document.title = `${scene.name} – maquette`;
  $("name").textContent = scene.name;
  $("backend").replaceChildren(new Option("as planned", ""), ...scene.backends.map((name) => new Option(name, name)));
  $("channel").replaceChildren(...scene.channels.map(([name, label], k) => new Option(`${k + 1} ${label}`, name)));
  scene.channels.slice(0, 9).forEach(([name], k) => { keys[k + 1] = () => change({ channel: name }); });
  const select = $("camera");
  select.replaceChildren(new Option("the first", ""), ...scene.cameras.map((name) => new Option(name, name)));
  timeline = scene.timeline;
  $("timeline").hidden = !timeline;
  $("stage").classList.toggle("timed", Boolean(timeline));
  if (timeline) Object.assign($("moment"), { min: timeline.first, max: timeline.last, step: "any" });
  else stop();
  show();
});
link.on("view", (view) => { $("facts").textContent = `${view.size[0]} × ${view.size[1]}, ${view.backend}${view.camera ? `, ${view.camera}` : ""}`; });
link.on("picture", ({ about }) => { shownExposure = about.exposure; metered = about.metered; showExposure(); });
link.on("outline", (message) => picture.outlines(message));
link.on("camera", async (message) => {
  try { await navigator.clipboard.writeText(message.text); messages.toast(`Copied: ${message.text}`); }
  catch { messages.toast(message.text); }
});

// --- view ---

let shownExposure = 0, metered = false;

function showExposure() {
  const stops = state.exposure ?? shownExposure;
  const slider = $("exposure");
  if (document.activeElement !== slider || state.exposure === null) {
    const middle = state.exposure === null || slider.min === "" ? shownExposure : (Number(slider.min) + Number(slider.max)) / 2;
    slider.min = Math.floor(middle) - 6;
    slider.max = Math.floor(middle) + 6;
    slider.value = stops;
  }
  $("exposure-text").textContent = `${stops.toFixed(1)} ev${state.exposure === null && metered ? " auto" : ""}`;
  $("auto-exposure").disabled = state.exposure === null;
}

function show() {
  $("camera").value = state.camera ?? "";
  $("backend").value = state.backend ?? "";
  $("channel").value = state.channel;
  $("reset-view").disabled = state.pose === null && state.camera === null;
  showExposure();
  if (timeline) {
    const moment = state.moment ?? timeline.first;
    $("moment").value = moment;
    $("moment-text").textContent = timeline.unit === "s" ? `${moment.toFixed(2)} s` : `frame ${moment.toFixed(0)}`;
  }
}

$("camera").addEventListener("change", (event) => change({ camera: event.target.value || null, pose: null }));
$("backend").addEventListener("change", (event) => change({ backend: event.target.value || null }));
$("channel").addEventListener("change", (event) => change({ channel: event.target.value }));
$("exposure").addEventListener("input", (event) => change({ exposure: Number(event.target.value) }));
$("auto-exposure").addEventListener("click", () => change({ exposure: null }));
$("reset-view").addEventListener("click", () => change({ pose: null, camera: null }));
$("copy-camera").addEventListener("click", () => link.send({ type: "camera" }));
const brighter = (by) => change({ exposure: Math.round(10 * ((state.exposure ?? shownExposure) + by)) / 10 });

// --- time ---

$("moment").addEventListener("input", (event) => { stop(); change({ moment: Number(event.target.value) }); });
$("play").addEventListener("click", () => (playing ? stop() : play()));

function play() {
  if (!timeline) return;
  const span = timeline.last - timeline.first;
  let from = state.moment ?? timeline.first;
  if (from >= timeline.last) from = timeline.first;
  const began = performance.now();
  let seen = picture.count, asked = 0;
  playing = setInterval(() => {
    const now = performance.now();
    if (picture.count === seen && now - asked < 2000) return; // the picture of the last moment comes first
    [seen, asked] = [picture.count, now];
    const passed = ((now - began) / 1000) * timeline.rate;
    const moment = timeline.first + ((from - timeline.first + passed) % (span || 1));
    change({ moment: timeline.unit === "s" ? moment : Math.floor(moment) });
  }, 16);
  $("play").textContent = "Stop";
}

function stop() {
  clearInterval(playing);
  playing = null;
  $("play").textContent = "Play";
}

// --- layout ---

const main = $("main");
function toggle(name, on) {
  const hidden = on === undefined ? !main.classList.contains(`no-${name}`) : !on;
  main.classList.toggle(`no-${name}`, hidden);
  $(`toggle-${name}`).ariaPressed = String(!hidden);
  keep(`maquette-${name}`, hidden ? "off" : "on");
}
function keep(name, value) {
  try { localStorage.setItem(name, value); } catch { /* private windows have no storage */ }
}
function kept(name) {
  try { return localStorage.getItem(name); } catch { return null; }
}
const dark = matchMedia("(prefers-color-scheme: dark)");
function paint() {
  document.documentElement.dataset.theme = kept("maquette-theme") ?? (dark.matches ? "dark" : "light");
}
function repaint() {
  keep("maquette-theme", document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  paint();
}
dark.addEventListener("change", paint);
paint();
for (const name of ["editor", "panel"]) {
  toggle(name, kept(`maquette-${name}`) !== "off");
  $(`toggle-${name}`).addEventListener("click", () => toggle(name));
}
$("toggle-theme").addEventListener("click", repaint);
$("toggle-help").addEventListener("click", () => $("help").showModal());
link.on("files", (message) => {
  $("toggle-editor").hidden = message.items.length === 0;
  if (message.items.length === 0) main.classList.add("no-editor");
});

$("splitter").addEventListener("pointerdown", (event) => {
  const splitter = event.currentTarget;
  splitter.setPointerCapture(event.pointerId);
  const move = (at) => main.style.setProperty("--editor", `${Math.min(Math.max(at.clientX, 200), innerWidth * 0.6)}px`);
  splitter.addEventListener("pointermove", move);
  splitter.addEventListener("pointerup", () => splitter.removeEventListener("pointermove", move), { once: true });
});

$("all").hidden = !/\/scene\/[0-9a-f]+\/$/.test(location.pathname);

// --- inside the preview of VS Code, which has the source: tools/vscode ---

if (parent !== window) {
  main.classList.add("no-editor", "embedded");
  $("toggle-editor").hidden = true;
  editor.elsewhere = ({ path, line, column }) => parent.postMessage({ type: "jump", path, line, column }, "*");
  addEventListener("message", ({ source, origin, data }) => {
    if (source !== parent || !origin.startsWith("vscode-webview://") || !editor.files.has(data?.path)) return;
    editor.replace(data.path, String(data.text));
    editor.sendText(data.path);
  });
  link.on("files", () => { $("toggle-editor").hidden = true; });
  let asked = false;
  link.on("files", () => { if (!asked) parent.postMessage({ type: "ready" }, "*"); asked = true; });
}

// --- keys ---

const keys = {
  e: () => toggle("editor"), p: () => toggle("panel"), t: repaint, c: () => link.send({ type: "camera" }), d: () => $("png").click(),
  f: () => { picture.fill = !picture.fill; picture.fit(); }, Home: () => change({ pose: null, camera: null }), "[": () => brighter(-0.3),
  "]": () => brighter(0.3), 0: () => change({ exposure: null }), " ": () => (playing ? stop() : play()), "?": () => $("help").showModal(),
  Escape: () => messages.unpick(),
};
addEventListener("keydown", (event) => {
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "s") {
    event.preventDefault();
    editor.save();
    return;
  }
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest?.(TYPING) || $("help").open) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (!(key in keys) || (key === " " && event.target.closest?.("button, a"))) return;
  event.preventDefault();
  keys[key]();
});
