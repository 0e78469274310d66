// The socket: messages and pictures from the server, reconnection with the state of the page.
const RETRY = [200, 400, 800, 1500, 3000]; // milliseconds between attempts

export class Link extends EventTarget {
  constructor(carried) {
    super();
    this.carried = carried; // () => {state, texts}: what a restarted server gets
    this.boot = null;
    this.page = 0;
    this.failures = 0;
    this.socket = null;
    this.connect();
  }

  connect() {
    const address = new URL("socket", location.href);
    address.protocol = "ws:";
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.addEventListener("open", () => {
      const hello = { type: "hello", boot: this.boot };
      if (this.boot !== null) Object.assign(hello, this.carried());
      socket.send(JSON.stringify(hello));
    });
    socket.addEventListener("message", (event) => {
      if (typeof event.data === "string") this.take(JSON.parse(event.data));
      else this.picture(event.data);
    });
    socket.addEventListener("close", () => {
      if (this.socket !== socket) return;
      this.socket = null;
      this.emit("status", "lost");
      const wait = RETRY[Math.min(this.failures++, RETRY.length - 1)];
      setTimeout(() => this.connect(), wait);
    });
  }

  take(message) {
    if (message.type === "hello") {
      this.boot = message.boot;
      this.page = message.page;
      this.failures = 0;
      this.emit("status", "open");
    }
    this.emit(message.type, message);
  }

  picture(buffer) {
    const length = new DataView(buffer).getUint32(0, true);
    const about = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    this.emit("picture", { about, pixels: new Uint8ClampedArray(buffer, 4 + length) });
  }

  emit(type, detail) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }

  on(type, listener) {
    this.addEventListener(type, (event) => listener(event.detail));
  }

  send(message) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}
