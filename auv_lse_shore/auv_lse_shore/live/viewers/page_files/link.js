// The connection to the server: reconnects by itself and continues after the last event received.

export class Link {
  constructor(store, onState) {
    this.store = store;
    this.onState = onState;
    this.name = "";
    this.have = 0;
    this.waitS = 0.5;
    this.connect();
  }

  connect() {
    this.onState({ connection: "connecting" });
    const socket = new WebSocket(`ws://${location.host}/events`);
    let alive = setTimeout(() => socket.close(), 8000);
    socket.onopen = () => socket.send(JSON.stringify({ name: this.name, have: this.have }));
    socket.onmessage = (message) => {
      clearTimeout(alive);
      alive = setTimeout(() => socket.close(), 8000); // the server sends something every few seconds
      this.waitS = 0.5;
      this.take(JSON.parse(message.data));
    };
    socket.onclose = () => {
      clearTimeout(alive);
      this.onState({ connection: "lost" });
      setTimeout(() => this.connect(), 1000 * this.waitS);
      this.waitS = Math.min(5, 1.5 * this.waitS);
    };
  }

  take({ name, from, events, more, state }) {
    if (name !== this.name || from !== this.have) {
      this.name = name;
      this.have = from;
      if (from === 0) this.store.begin(null);
    }
    for (const event of events) this.store.add(event);
    this.have += events.length;
    this.onState({ connection: "open", loading: more || Boolean(state.reading), ...state });
  }
}
