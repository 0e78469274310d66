// Diagnostics over the picture, what a click found, the plan, and the progress.
export class Messages {
  constructor(link, editor, picture) {
    this.editor = editor;
    this.picture = picture;
    this.stage = document.getElementById("stage");
    this.root = document.getElementById("messages");
    this.open = false; // whether warnings are shown
    link.on("diagnostics", (message) => this.diagnostics(message));
    link.on("pick", (message) => this.pick(message));
    link.on("plan", (message) => this.plan(message.rows));
    link.on("progress", (message) => this.progress(message));
    link.on("refused", (message) => this.toast(message.message));
  }

  diagnostics({ failed, items }) {
    const shape = JSON.stringify([failed, items]);
    if (shape === this.shape) return;
    this.shape = shape;
    this.stage.classList.toggle("failed", failed);
    this.editor.underline(items);
    const errors = items.filter((item) => item.severity === "error");
    const rest = items.filter((item) => item.severity !== "error");
    const shown = [];
    if (errors.length) shown.push(this.box("error", errors));
    if (rest.length) {
      const chip = element("button", `${rest.length} ${rest.length === 1 ? rest[0].severity : "messages"}`, "chip");
      chip.type = "button";
      chip.ariaExpanded = String(this.open);
      const list = this.box("warning", rest);
      list.hidden = !this.open;
      chip.addEventListener("click", () => {
        this.open = list.hidden;
        list.hidden = !this.open;
        chip.ariaExpanded = String(this.open);
      });
      shown.push(list, chip);
    }
    this.root.replaceChildren(...shown);
  }

  box(kind, items) {
    const box = element("div", "", `message ${kind}`);
    for (const item of items) {
      const [first, ...rest] = item.text.split("\n");
      const text = element("pre", "");
      text.append(element("span", first, "first"), rest.length ? `\n${rest.join("\n")}` : "");
      if (item.place?.path) {
        text.classList.add("jump");
        text.title = "Show in the source";
        text.addEventListener("click", () => this.editor.jump(item.place));
      }
      box.append(text);
    }
    return box;
  }

  toast(text) {
    const note = element("div", "", "message note");
    note.append(element("pre", text));
    this.root.append(note);
    setTimeout(() => note.remove(), 5000);
  }

  pick(found) {
    const root = document.getElementById("picked");
    root.hidden = false;
    this.picture.marked = { x: found.x, y: found.y };
    this.picture.place();
    const close = element("button", "×", "close");
    close.type = "button";
    close.ariaLabel = "Close";
    close.addEventListener("click", () => this.unpick());
    const list = element("dl", "");
    const row = (name, value) => { if (value) list.append(element("dt", name), wrapped(value)); };
    if (found.luminance !== null && found.luminance !== undefined) row("luminance", `${+found.luminance.toPrecision(3)} cd/m²`);
    if (!found.hit) {
      root.replaceChildren(element("h3", "Background"), list, close);
      return;
    }
    row("shape", found.name ? found.shape : "");
    row("material", [found.material, found.model].filter(Boolean).join(", "));
    row("light", found.light);
    row("depth", found.depth === null ? "" : `${+found.depth.toPrecision(4)} m`);
    row("line", this.place(found.place));
    if (found.material_place?.name !== found.place?.name) row("material line", this.place(found.material_place));
    root.replaceChildren(element("h3", found.name || found.shape), list, close);
    if (found.place) this.editor.files.has(found.place.path) && !matchMedia("(max-width: 760px)").matches && this.editor.jump(found.place);
  }

  unpick() {
    document.getElementById("picked").hidden = true;
    this.picture.marked = null;
    this.picture.place();
  }

  place(place) {
    if (!place) return "";
    if (!this.editor.files.has(place.path)) return place.name;
    const link = element("button", place.name.split("/").at(-1), "linkish");
    link.type = "button";
    link.addEventListener("click", () => this.editor.jump(place));
    return link;
  }

  plan(rows) {
    const root = document.getElementById("plan");
    const shown = rows.map((row) => {
      const item = document.createElement("details");
      const head = element("summary", "");
      head.append(element("b", row.name), element("span", row.value));
      const reason = element("p", row.reason);
      const change = element("p", "changed by ");
      change.append(element("code", row.switch));
      item.append(head, reason, change);
      if (!row.matters) item.className = "rest";
      return item;
    });
    const open = root.querySelector(".more")?.open;
    const more = element("details", "", "more");
    more.open = Boolean(open);
    const first = shown.filter((_, k) => rows[k].matters);
    const rest = shown.filter((_, k) => !rows[k].matters);
    more.append(element("summary", `All ${rows.length} decisions`), ...rest);
    root.replaceChildren(...first, more);
  }

  progress(found) {
    const done = found.stage === "done", failed = found.stage === "failed";
    document.getElementById("done").style.width = failed ? "0" : `${Math.round(100 * found.share)}%`;
    const parts = [];
    if (found.samples) parts.push(`${+found.samples.toPrecision(3)}${found.most > 1 ? ` of ${found.most}` : ""} ${found.samples === 1 ? "sample" : "samples"}`);
    if (found.error !== null && found.error !== undefined) parts.push(`${done ? "error" : "noise"} ${(100 * found.error).toFixed(2)} %${found.denoised ? " before denoising" : ""}${found.told ? ` (${found.told})` : ""}`);
    if (found.denoised) parts.push(done ? "denoised" : "denoised preview");
    if (done) parts.push(`${found.seconds.toFixed(found.seconds < 10 ? 2 : 0)} s`);
    const stage = done ? "done" : failed ? "errors in the scene" : found.stage;
    const status = document.getElementById("status");
    status.textContent = [stage, ...parts].join(", ");
    status.dataset.stage = found.stage;
  }
}

function element(name, text, kind = "") {
  const made = document.createElement(name);
  made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

function wrapped(value) {
  const made = document.createElement("dd");
  made.append(value);
  return made;
}
