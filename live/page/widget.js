// The widget of notebooks: picture and params over the messages of a model. notebook.py puts canvas.js and controls.js before it.
class Channel extends EventTarget {
  constructor(model) {
    super();
    this.model = model;
    this.listener = (message, buffers) => this.take(message, buffers);
    model.on("msg:custom", this.listener);
  }

  take(message, buffers) {
    if (message.type !== "picture") return this.emit(message.type, message);
    const data = buffers[0], bytes = new Uint8ClampedArray(data.buffer ?? data, data.byteOffset ?? 0, data.byteLength);
    this.emit("picture", { about: message.about, pixels: new Uint8ClampedArray(bytes) });
    this.send({ type: "shown" });
  }

  emit(type, detail) { this.dispatchEvent(new CustomEvent(type, { detail })); }
  on(type, listener) { this.addEventListener(type, (event) => listener(event.detail)); }
  send(message) { this.model.send(message); return true; }
  close() { this.model.off("msg:custom", this.listener); }
}

function render({ model, el }) {
  el.innerHTML = `<div class="maquette"><div id="view"><canvas id="picture" width="1" height="1" tabindex="0"></canvas>
    <canvas id="outline" hidden></canvas><div id="mark" hidden></div></div><pre id="messages" hidden></pre>
    <div id="side"><div id="params"></div><button id="write" type="button" disabled>Write to source</button><span id="picked"></span></div><div id="progress">starting …</div></div>`;
  const find = (id) => el.querySelector(id);
  const link = new Channel(model);
  const change = (state) => link.send({ type: "change", state });
  new Picture(link, change, el);
  const controls = new Controls(link, change, el);
  link.on("picture", ({ about }) => { find("#view").style.height = `${Math.min(about.full[1], about.full[1] * find("#view").clientWidth / about.full[0])}px`; });
  link.on("progress", ({ stage, share }) => {
    find("#progress").hidden = stage === "done" || stage === "failed";
    find("#progress").textContent = share > 0 ? `${stage}, ${Math.round(100 * share)} %` : `${stage} …`;
  });
  link.on("state", (message) => controls.restore(message.state.sets));
  link.on("params", (message) => { find("#side").hidden = message.items.length === 0; });
  link.on("pick", (found) => { find("#picked").textContent = found.hit ? [found.name || found.shape, found.place?.name].filter(Boolean).join(", ") : ""; });
  link.on("diagnostics", ({ items }) => {
    const errors = items.filter((item) => item.severity === "error");
    find("#messages").hidden = errors.length === 0;
    find("#messages").textContent = errors.map((item) => item.text).join("\n");
  });
  link.send({ type: "hello", boot: null });
  return () => link.close();
}
export default { render };
