// The picture on its canvas, and the camera that the mouse moves.
const add = (a, b, s = 1) => a.map((v, i) => v + s * b[i]);
const sub = (a, b) => a.map((v, i) => v - b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const unit = (a) => { const n = length(a) || 1; return a.map((v) => v / n); };
const turned = (v, axis, angle) => { // Rodrigues' rotation
  const c = Math.cos(angle), s = Math.sin(angle), w = cross(axis, v), d = dot(axis, v) * (1 - c);
  return v.map((x, i) => x * c + w[i] * s + axis[i] * d);
};
const STEEPEST = 0.998; // cosine of the smallest angle between the view and up
const OUTLINED = 2500; // milliseconds
const STILL = 4; // pixels that a click may move

export class Picture {
  constructor(link, change, root = document) {
    this.link = link;
    this.change = change; // (state) => void
    [this.canvas, this.stage, this.mark, this.outline] = ["#picture", "#view", "#mark", "#outline"].map((id) => root.querySelector(id));
    this.context = this.canvas.getContext("2d");
    this.full = [0, 0];
    this.margin = root === document ? 24 : 0; // pixels around the picture, where there is room
    this.fill = false;
    this.view = null; // the camera that is shown
    this.drag = null;
    this.wheeling = 0;
    this.marked = null;
    this.count = 0; // pictures shown
    link.on("picture", (picture) => this.show(picture));
    link.on("view", (view) => { if (!this.drag && !this.wheeling) this.view = view; });
    new ResizeObserver(() => this.fit()).observe(this.stage);
    this.listen();
  }

  show({ about, pixels }) {
    if (this.canvas.width !== about.width || this.canvas.height !== about.height) {
      this.canvas.width = about.width;
      this.canvas.height = about.height;
    }
    this.context.putImageData(new ImageData(pixels, about.width, about.height), 0, 0);
    this.about = about;
    this.full = about.full;
    this.count += 1;
    this.canvas.dataset.count = this.count;
    this.canvas.dataset.version = about.version;
    this.canvas.dataset.finished = about.finished;
    this.canvas.dataset.channel = about.channel;
    this.fit();
  }

  fit() {
    const [width, height] = this.full;
    if (!width) return;
    const margin = this.stage.clientWidth > 600 ? this.margin : 0;
    const most = Math.min((this.stage.clientWidth - margin) / width, (this.stage.clientHeight - margin) / height);
    const scale = this.fill || most < 1 ? most : Math.max(1, Math.floor(most / 2)); // small pictures grow by whole numbers
    this.canvas.classList.toggle("enlarged", scale > 1);
    this.canvas.style.width = `${Math.max(1, Math.floor(width * scale))}px`;
    this.canvas.style.height = `${Math.max(1, Math.floor(height * scale))}px`;
    this.place();
  }

  // Draw outlines of a part of the scene over the picture: runs of pixels of the channel's size. They fade after a while.
  outlines({ width, height, runs }) {
    const canvas = this.outline;
    clearTimeout(this.fading);
    canvas.hidden = runs.length === 0;
    if (canvas.hidden) return;
    canvas.width = width;
    canvas.height = height;
    const context = canvas.getContext("2d");
    context.fillStyle = "#fff";
    for (let k = 0; k < runs.length; k += 3) context.fillRect(runs[k + 1], runs[k], runs[k + 2], 1);
    canvas.classList.remove("faded");
    this.place();
    this.fading = setTimeout(() => canvas.classList.add("faded"), OUTLINED);
  }

  unoutline() {
    clearTimeout(this.fading);
    this.outline.hidden = true;
  }

  place() {
    const { offsetLeft, offsetTop, offsetWidth, offsetHeight } = this.canvas;
    Object.assign(this.outline.style, { left: `${offsetLeft}px`, top: `${offsetTop}px`, width: `${offsetWidth}px`, height: `${offsetHeight}px` });
    this.mark.hidden = !this.marked;
    if (!this.marked) return;
    this.mark.style.left = `${this.canvas.offsetLeft + this.marked.x * this.canvas.offsetWidth}px`;
    this.mark.style.top = `${this.canvas.offsetTop + this.marked.y * this.canvas.offsetHeight}px`;
  }

  listen() {
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button > 1) return;
      canvas.setPointerCapture(event.pointerId);
      canvas.focus({ preventScroll: true });
      this.drag = { x: event.clientX, y: event.clientY, moved: 0, pan: event.shiftKey || event.button === 1 };
      event.preventDefault();
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!this.drag || !this.view) return;
      const dx = event.clientX - this.drag.x, dy = event.clientY - this.drag.y;
      this.drag.moved = Math.max(this.drag.moved, Math.hypot(dx, dy));
      if (this.drag.moved < STILL) return;
      canvas.classList.add("dragging");
      this.drag.x = event.clientX;
      this.drag.y = event.clientY;
      this.drag.moved = Infinity;
      if (this.drag.pan) this.pan(dx, dy);
      else this.orbit(dx, dy);
    });
    const end = (event) => {
      if (!this.drag) return;
      const click = this.drag.moved < STILL && event.type === "pointerup";
      this.drag = null;
      canvas.classList.remove("dragging");
      if (click) this.click(event);
    };
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(event.deltaY * (event.deltaMode === 1 ? 16 : 1));
      clearTimeout(this.wheeling);
      this.wheeling = setTimeout(() => { this.wheeling = 0; }, 400);
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-24, 0], ArrowRight: [24, 0], ArrowUp: [0, -24], ArrowDown: [0, 24] }[event.key];
      if (step && this.view) {
        event.preventDefault();
        if (event.shiftKey) this.pan(...step);
        else this.orbit(...step);
      } else if (event.key === "+" || event.key === "-") this.zoom(event.key === "+" ? -100 : 100);
    });
  }

  click(event) {
    const box = this.canvas.getBoundingClientRect();
    this.link.send({ type: "pick", x: (event.clientX - box.left) / box.width, y: (event.clientY - box.top) / box.height });
  }

  // Axes of the camera: right, up, and the world's up, which is the camera's own where it is rolled.
  axes() {
    const { position, look_at, up } = this.view;
    const ahead = unit(sub(look_at, position));
    const right = unit(cross(ahead, up));
    const above = cross(right, ahead);
    return { ahead, right, above, pole: Math.abs(right[1]) < 0.02 && above[1] > 0 ? [0, 1, 0] : above };
  }

  orbit(dx, dy) {
    const { ahead, right, pole } = this.axes();
    const around = this.view.projection === "panoramic";
    const speed = around ? 0.003 : 0.008;
    let next = turned(turned(ahead, pole, -dx * speed), turned(right, pole, -dx * speed), -dy * speed);
    if (Math.abs(dot(next, pole)) > STEEPEST) next = turned(ahead, pole, -dx * speed);
    const distance = length(sub(this.view.look_at, this.view.position));
    if (around) this.move(this.view.position, add(this.view.position, next, distance), pole);
    else this.move(add(this.view.look_at, next, -distance), this.view.look_at, pole);
  }

  pan(dx, dy) {
    const { right, above, pole } = this.axes();
    const orthographic = this.view.projection === "orthographic";
    const distance = orthographic ? 1 : length(sub(this.view.look_at, this.view.position));
    const side = this.view.horizontal ? this.canvas.clientWidth : this.canvas.clientHeight;
    const pixel = (2 * this.view.extent * distance) / Math.max(side, 1);
    const by = add(add([0, 0, 0], right, -dx * pixel), above, dy * pixel);
    this.move(add(this.view.position, by), add(this.view.look_at, by), pole);
  }

  zoom(amount) {
    if (!this.view) return;
    const factor = Math.exp(amount * 0.0012);
    const { pole } = this.axes();
    if (this.view.projection === "orthographic") {
      this.view.extent *= factor;
      this.move(this.view.position, this.view.look_at, pole);
      return;
    }
    const back = sub(this.view.position, this.view.look_at);
    this.move(add(this.view.look_at, back, factor), this.view.look_at, pole);
  }

  move(position, look_at, up) {
    Object.assign(this.view, { position, look_at, up });
    this.change({ pose: { position, look_at, up, extent: this.view.projection === "orthographic" ? this.view.extent : null } });
  }
}
