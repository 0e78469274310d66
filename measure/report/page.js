// Of a chart's page: what a point is, shown under the pointer or the keyboard's focus; a click or Enter copies its command.
"use strict";
const points = JSON.parse(document.getElementById("points").textContent);
const tip = document.getElementById("tip");
const said = document.getElementById("said");
const parts = points.map((_, i) => [document.getElementById(`point-${i}`), document.querySelector(`tr[data-point="${i}"]`)]);

function show(i, x, y) {
  const point = points[i];
  const add = (parent, name, text) => parent.appendChild(Object.assign(document.createElement(name), { textContent: text }));
  tip.replaceChildren();
  add(tip, "b", point.title);
  const list = add(tip, "dl", "");
  for (const [name, text] of point.figures) { add(list, "dt", name); add(list, "dd", text); }
  add(tip, "code", point.command);
  add(tip, "small", " click copies it");
  tip.style.display = "block";
  const box = tip.getBoundingClientRect();
  tip.style.left = `${Math.max(8, Math.min(x + 16, innerWidth - box.width - 8))}px`;
  tip.style.top = `${y + box.height + 24 < innerHeight ? y + 16 : Math.max(8, y - box.height - 16)}px`;
  light(i, true);
}

function light(i, on) { for (const part of parts[i]) part.classList.toggle("lit", on); }

function hide(i) { tip.style.display = "none"; light(i, false); }

async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch { // a page opened from a disk may have no clipboard of that kind
    const field = document.body.appendChild(Object.assign(document.createElement("textarea"), { value: text }));
    field.select();
    document.execCommand("copy");
    field.remove();
  }
  said.textContent = `copied: ${text}`;
}

parts.forEach((pair, i) => {
  for (const part of pair) {
    part.setAttribute("tabindex", "0");
    part.addEventListener("pointermove", (event) => show(i, event.clientX, event.clientY));
    part.addEventListener("pointerleave", () => hide(i));
    part.addEventListener("focus", () => { const box = part.getBoundingClientRect(); show(i, box.left, box.bottom); });
    part.addEventListener("blur", () => hide(i));
    part.addEventListener("click", () => copy(points[i].command));
    part.addEventListener("keydown", (event) => { if (event.key === "Enter") copy(points[i].command); });
  }
});

document.getElementById("theme").addEventListener("click", () => {
  const root = document.documentElement;
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
});
