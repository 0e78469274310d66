// The source pane: CodeMirror with one document a file of the scene.
import {
  Annotation, EditorState, EditorView, HighlightStyle, StreamLanguage, bracketMatching, defaultKeymap, drawSelection, highlightActiveLine,
  highlightActiveLineGutter, highlightSelectionMatches, highlightSpecialChars, history, historyKeymap, indentUnit, indentWithTab, keymap,
  lineNumbers, lintGutter, searchKeymap, setDiagnostics, syntaxHighlighting, tags,
} from "./codemirror.js";

const KEYWORDS = /^(?:use|as|unit|param|in|let|for|if|else|then|or|and|not|true|false)\b/;
const remote = Annotation.define(); // a change that the server or the disk made
const DELAY = 15; // milliseconds between messages of a text

const language = StreamLanguage.define({
  name: "scene",
  token(stream) {
    if (stream.eatSpace()) return null;
    if (stream.match(/^\/\/.*/)) return "comment";
    if (stream.match(/^"(?:[^"\\]|\\.)*"?/)) return "string";
    if (stream.match(/^#[0-9a-fA-F]{3,6}\b/)) return "color";
    if (stream.match(/^\d[\d_]*(?:\.\d+)?(?:[eE][+-]?\d+)?(?:%|[a-zA-Zµ°]+)?/)) return "number";
    if (stream.match(KEYWORDS)) return "keyword";
    if (stream.match(/^[A-Za-z_]\w*(?=\s*\()/)) return "variableName.function";
    if (stream.match(/^[A-Za-z_]\w*(?=\s*:)/)) return "propertyName";
    if (stream.match(/^[A-Za-z_]\w*/)) return "variableName";
    stream.next();
    return null;
  },
  languageData: { commentTokens: { line: "//" } },
});

const colors = HighlightStyle.define([
  { tag: tags.keyword, color: "var(--keyword)" },
  { tag: [tags.number, tags.color], color: "var(--number)" },
  { tag: tags.string, color: "var(--string)" },
  { tag: tags.comment, color: "var(--comment)", fontStyle: "italic" },
  { tag: tags.function(tags.variableName), color: "var(--call)" },
  { tag: tags.propertyName, color: "var(--soft)" },
]);

const theme = EditorView.theme({
  "&": { color: "var(--text)", backgroundColor: "var(--surface)" },
  "&.cm-focused": { outline: "none" },
  ".cm-scroller": { fontFamily: 'ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace', lineHeight: "1.55" },
  ".cm-content": { caretColor: "var(--text)" },
  ".cm-cursor": { borderLeftColor: "var(--text)" },
  ".cm-gutters": { backgroundColor: "var(--surface)", color: "var(--comment)", border: "none" },
  ".cm-activeLine, .cm-activeLineGutter": { backgroundColor: "var(--active)" },
  "&.cm-focused > .cm-scroller > .cm-selectionLayer .cm-selectionBackground, .cm-selectionBackground": { backgroundColor: "var(--selection)" },
  ".cm-panels": { backgroundColor: "var(--raised)", color: "var(--text)", borderColor: "var(--line)" },
  ".cm-tooltip": { backgroundColor: "var(--surface)", color: "var(--text)", borderColor: "var(--line)" },
  ".cm-selectionMatch": { backgroundColor: "var(--selection)" },
  ".cm-matchingBracket": { backgroundColor: "var(--selection) !important" },
});

export class Editor {
  constructor(link) {
    this.link = link;
    this.files = new Map(); // path -> {name, state, disk, saved, crlf, missing, conflict}
    this.shown = null;
    this.timers = new Map();
    this.waiting = new Set(); // paths whose text has changed since it was sent
    this.elsewhere = null; // (place) => void: shows places where the source is in another editor
    this.tabs = document.getElementById("tabs");
    this.button = document.getElementById("save");
    this.conflict = document.getElementById("conflict");
    this.view = new EditorView({ parent: document.getElementById("code"), state: this.newState("") });
    this.button.addEventListener("click", () => this.save());
    document.getElementById("take-disk").addEventListener("click", () => this.resolve(true));
    document.getElementById("keep-mine").addEventListener("click", () => this.resolve(false));
    link.on("files", (message) => this.take(message.items));
    link.on("text", (message) => this.replace(message.path, message.text));
    link.on("conflict", (message) => { this.files.get(message.path).conflict = true; this.mark(); });
    link.on("saved", (message) => { this.files.get(message.path).conflict = false; this.mark(); });
  }

  newState(text) {
    return EditorState.create({
      doc: text,
      extensions: [
        lineNumbers(), highlightActiveLineGutter(), highlightSpecialChars(), history(), drawSelection(), bracketMatching(), highlightActiveLine(),
        highlightSelectionMatches(), lintGutter(), indentUnit.of("    "), language, syntaxHighlighting(colors), theme,
        keymap.of([
          { key: "Mod-s", preventDefault: true, run: () => { this.save(); return true; } },
          indentWithTab, ...defaultKeymap, ...historyKeymap, ...searchKeymap,
        ]),
        EditorView.contentAttributes.of({ "aria-label": "Source of the scene" }),
        EditorView.updateListener.of((update) => {
          if (update.selectionSet || update.docChanged) this.moved(update);
          if (!update.docChanged) return;
          const own = !update.transactions.some((transaction) => transaction.annotation(remote));
          if (own && this.shown) this.later(this.shown);
          this.mark();
        }),
      ],
    });
  }

  // --- texts ---

  text(path) {
    const file = this.files.get(path);
    const state = path === this.shown ? this.view.state : file.state;
    const text = state.doc.toString();
    return file.crlf ? text.replaceAll("\n", "\r\n") : text;
  }

  dirty(path) {
    return this.text(path) !== this.files.get(path).disk;
  }

  unsaved() {
    return Object.fromEntries([...this.files.keys()].filter((path) => this.dirty(path)).map((path) => [path, this.text(path)]));
  }

  // Send a changed text: the first change at once, those that follow it closely together.
  later(path) {
    if (this.timers.has(path)) {
      this.waiting.add(path);
      return;
    }
    this.sendText(path);
    this.timers.set(path, setTimeout(() => { this.timers.delete(path); if (this.waiting.has(path)) this.later(path); }, DELAY));
  }

  settle(path) {
    clearTimeout(this.timers.get(path));
    this.timers.delete(path);
    this.waiting.delete(path);
  }

  sendText(path) {
    this.settle(path);
    this.link.send({ type: "text", path, text: this.text(path) });
  }

  take(items) {
    for (const item of items) {
      const text = item.text ?? "";
      const file = this.files.get(item.path);
      if (!file) {
        this.files.set(item.path, {
          name: item.name, state: this.newState((item.unsaved ?? text).replaceAll("\r\n", "\n")), disk: text, saved: item.saved,
          crlf: text.includes("\r\n"), missing: item.text === null, conflict: false,
        });
        continue;
      }
      const clean = !this.dirty(item.path);
      const changed = item.saved !== file.saved;
      file.missing = item.text === null;
      if (file.missing) continue; // the text stays, to be saved again
      file.disk = text;
      file.crlf = text.includes("\r\n");
      if (changed && clean) this.replace(item.path, item.unsaved ?? text);
      else if (changed && this.dirty(item.path)) file.conflict = true;
      if (!this.dirty(item.path)) file.conflict = false;
      if (!file.conflict) file.saved = item.saved;
    }
    const listed = new Set(items.map((item) => item.path));
    for (const path of [...this.files.keys()]) if (!listed.has(path) && !this.dirty(path)) this.files.delete(path);
    if (!this.files.has(this.shown)) this.open(items[0]?.path ?? null);
    this.list();
    this.mark();
    document.getElementById("editor").hidden = items.length === 0;
  }

  replace(path, text) {
    const file = this.files.get(path);
    if (!file) return;
    const doc = text.replaceAll("\r\n", "\n");
    const state = path === this.shown ? this.view.state : file.state;
    const before = state.doc.toString();
    if (before === doc) return;
    let from = 0; // only what differs is replaced, so that the cursor stays
    while (from < Math.min(before.length, doc.length) && before[from] === doc[from]) from += 1;
    let end = 0;
    while (end < Math.min(before.length, doc.length) - from && before.at(-1 - end) === doc.at(-1 - end)) end += 1;
    const change = { changes: { from, to: before.length - end, insert: doc.slice(from, doc.length - end) }, annotations: remote.of(true) };
    if (path === this.shown) this.view.dispatch(change);
    else file.state = state.update(change).state;
    this.mark();
  }

  // --- files ---

  open(path) {
    if (this.shown && this.files.has(this.shown)) this.files.get(this.shown).state = this.view.state;
    this.shown = path;
    if (path) this.view.setState(this.files.get(path).state);
    this.list();
    this.mark();
    if (this.items) this.underline(this.items);
  }

  list() {
    this.tabs.replaceChildren(...[...this.files].map(([path, file]) => {
      const tab = document.createElement("button");
      tab.type = "button";
      tab.role = "tab";
      tab.textContent = file.name;
      tab.title = path;
      tab.dataset.path = path;
      tab.ariaSelected = String(path === this.shown);
      tab.addEventListener("click", () => this.open(path));
      return tab;
    }));
  }

  mark() {
    for (const tab of this.tabs.children) tab.classList.toggle("dirty", this.files.has(tab.dataset.path) && this.dirty(tab.dataset.path));
    const file = this.files.get(this.shown);
    this.button.disabled = !file || !(this.dirty(this.shown) || file.missing);
    this.conflict.hidden = !file || !(file.conflict || file.missing);
    document.getElementById("take-disk").hidden = Boolean(file?.missing);
    document.getElementById("keep-mine").hidden = Boolean(file?.missing);
    document.getElementById("conflict-text").textContent = file?.missing
      ? `${file.name} is missing on disk. Save writes it again.`
      : `${file?.name} was changed on disk, and here too.`;
  }

  save() {
    const path = this.shown, file = this.files.get(path);
    if (!file) return;
    this.settle(path);
    this.link.send({ type: "save", path, text: this.text(path), saved: file.saved, force: file.missing });
  }

  resolve(takeDisk) {
    const path = this.shown, file = this.files.get(path);
    file.conflict = false;
    if (takeDisk) {
      this.replace(path, file.disk);
      this.link.send({ type: "text", path, text: file.disk });
    } else {
      this.link.send({ type: "save", path, text: this.text(path), force: true });
    }
    this.mark();
  }

  // --- places ---

  // Ask for the outline of the statement at the cursor after a move of the cursor; a change of the text removes it.
  moved(update) {
    clearTimeout(this.outlining);
    const line = update.state.doc.lineAt(update.state.selection.main.head).number;
    this.outlined = !update.docChanged && update.view.hasFocus && this.shown ? { path: this.shown, line } : null;
    if (this.outlined) this.outlining = setTimeout(() => this.outlined && this.link.send({ type: "outline", ...this.outlined }), 60);
    else this.link.emit("outline", { runs: [] });
  }

  underline(items) {
    this.items = items;
    const doc = this.view.state.doc;
    const found = items.filter((item) => item.place?.path === this.shown && item.place.line > 0 && item.place.line <= doc.lines).map((item) => {
      const at = (line, column) => Math.min(doc.line(Math.min(line, doc.lines)).from + column - 1, doc.line(Math.min(line, doc.lines)).to);
      const from = at(item.place.line, item.place.column);
      const to = Math.max(from, at(item.place.end_line, item.place.end_column));
      return { from, to, severity: item.severity === "note" ? "info" : item.severity, message: item.hint ? `${item.message}\n${item.hint}` : item.message };
    });
    this.view.dispatch(setDiagnostics(this.view.state, found));
  }

  jump(place) {
    if (!this.files.has(place?.path)) return false;
    if (this.elsewhere) {
      this.elsewhere(place);
      return true;
    }
    if (this.shown !== place.path) this.open(place.path);
    const doc = this.view.state.doc;
    const line = doc.line(Math.min(Math.max(place.line, 1), doc.lines));
    const from = Math.min(line.from + Math.max(place.column - 1, 0), line.to);
    this.view.dispatch({ selection: { anchor: from }, effects: EditorView.scrollIntoView(from, { y: "center" }) });
    this.view.focus();
    return true;
  }
}
