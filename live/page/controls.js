// Controls of the params: sliders, colours, switches, choices.
const digits = (value) => String(+Number(value).toPrecision(6));

export class Controls {
  constructor(link, change, root = document) {
    this.change = change; // (state) => void
    [this.root, this.button] = ["#params", "#write"].map((id) => root.querySelector(id));
    this.rows = new Map();
    this.shape = "";
    this.sets = {};
    this.button.addEventListener("click", () => link.send({ type: "write_params" }));
    link.on("params", (message) => this.take(message.items));
  }

  take(items) {
    const shape = JSON.stringify(items.map(({ value, text, line, ...rest }) => rest));
    if (shape !== this.shape) {
      this.shape = shape;
      this.rows.clear();
      this.root.replaceChildren();
      if (!items.length) {
        const empty = document.createElement("p");
        empty.className = "empty";
        empty.textContent = "This scene has no params.";
        this.root.append(empty);
      }
      for (const item of items) this.add(item);
    }
    for (const item of items) {
      const row = this.rows.get(item.name);
      if (!row.root.contains(document.activeElement) || this.sets[item.name] === undefined || this.sets[item.name] === item.text) row.update(item);
    }
    this.mark();
  }

  add(item) {
    const root = document.createElement("div");
    root.className = "param";
    root.dataset.name = item.name;
    const head = document.createElement("div");
    head.className = "head";
    const name = document.createElement("b");
    name.textContent = item.name;
    const doc = document.createElement("span");
    doc.className = "doc";
    doc.textContent = doc.title = item.doc;
    const undo = document.createElement("button");
    undo.type = "button";
    undo.textContent = "reset";
    undo.addEventListener("click", () => this.set(item.name, null));
    head.append(name, doc, undo);
    const made = this[item.kind](item);
    for (const element of made.elements) element.setAttribute?.("aria-label", item.name);
    root.append(head, made.body);
    this.root.append(root);
    this.rows.set(item.name, { root, update: made.update });
  }

  set(name, text) {
    if (text === null) delete this.sets[name];
    else this.sets[name] = text;
    this.mark();
    this.change({ sets: { [name]: text } });
  }

  restore(sets) {
    this.sets = { ...sets };
    this.mark();
  }

  mark() {
    for (const [name, row] of this.rows) row.root.classList.toggle("set", this.sets[name] !== undefined);
    this.button.disabled = Object.keys(this.sets).length === 0;
  }

  slider(item) {
    const range = input("range", { min: item.low, max: item.high, step: item.step });
    const number = input("number", { min: item.low, max: item.high, step: item.type === "int" ? 1 : "any" });
    const body = pair(range, number);
    const send = (value) => this.set(item.name, item.type === "int" ? String(Math.round(value)) : digits(value) + item.unit);
    range.addEventListener("input", () => { number.value = digits(range.value); send(range.value); });
    number.addEventListener("input", () => {
      if (number.value === "" || !number.validity.valid) return;
      range.value = number.value;
      send(number.value);
    });
    number.title = item.unit;
    return { body, elements: [range, number], update: (to) => { range.value = to.value; number.value = digits(to.value); } };
  }

  number(item) {
    const number = input("number", { step: item.whole ? 1 : "any" });
    number.addEventListener("input", () => { if (number.value !== "") this.set(item.name, digits(number.value) + item.unit); });
    number.title = item.unit;
    return { body: number, elements: [number], update: (to) => { number.value = digits(to.value); } };
  }

  color(item) {
    const color = input("color", {});
    color.addEventListener("input", () => this.set(item.name, color.value));
    return { body: color, elements: [color], update: (to) => { color.value = to.value; } };
  }

  switch(item) {
    const box = input("checkbox", {});
    box.addEventListener("change", () => this.set(item.name, box.checked ? "true" : "false"));
    return { body: box, elements: [box], update: (to) => { box.checked = to.value; } };
  }

  choice(item) {
    const select = document.createElement("select");
    for (const { label, text } of item.choices) select.append(new Option(label, text));
    select.addEventListener("change", () => this.set(item.name, select.value));
    return { body: select, elements: [select], update: (to) => { select.value = to.text; } };
  }

  text(item) {
    const field = input("text", {});
    field.addEventListener("input", () => this.set(item.name, field.value || '""'));
    return { body: field, elements: [field], update: (to) => { field.value = to.value; } };
  }

  fixed() {
    const text = document.createElement("span");
    text.className = "empty";
    return { body: text, elements: [], update: (to) => { text.textContent = to.value; } };
  }
}

function input(type, attributes) {
  const made = document.createElement("input");
  made.type = type;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

function pair(...elements) {
  const made = document.createElement("span");
  made.className = "pair";
  made.append(...elements);
  return made;
}
