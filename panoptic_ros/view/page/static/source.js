// Where data come from: the server that the page came from, or the page itself if it was sent as a file.

import { unpack } from "#view/packets.js";

const AGAIN_MS = 1500; // before a lost server is tried again

export function openSource(handlers) {
  const element = document.getElementById("data");
  return element ? new InPage(JSON.parse(element.textContent), handlers) : new FromServer(handlers);
}

class FromServer {
  constructor(handlers) {
    this.handlers = handlers;
    this._open();
  }

  ask(block, keys) {
    this._say({ block, keys });
  }

  show(keys) {
    this._say({ keys });
  }

  drawn(number) {
    this._say({ drawn: number });
  }

  _say(words) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(words));
  }

  _open() {
    const address = new URL("data" + location.search, location.href);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = ({ data }) => {
      if (typeof data === "string") this.handlers.told(JSON.parse(data));
      else this.handlers.packet(unpack(data));
    };
    this.socket.onclose = () => {
      this.handlers.told({ type: "waiting", text: "the server is gone; trying again" });
      setTimeout(() => this._open(), AGAIN_MS);
    };
  }
}

class InPage {
  constructor(data, handlers) {
    this.data = data;
    this.handlers = handlers;
    queueMicrotask(() => {
      handlers.told(data.facts);
      handlers.told(data.presence);
    });
  }

  async ask(block) {
    const text = this.data.blocks[block];
    if (text === undefined) return;
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const plain = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    this.handlers.packet(unpack(await new Response(plain).arrayBuffer()));
  }

  show() {}

  drawn() {}
}
