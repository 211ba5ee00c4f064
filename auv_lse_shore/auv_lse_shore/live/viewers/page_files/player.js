// The time shown: playing, set by hand, or following the mission live.

const CALM = matchMedia("(prefers-reduced-motion: reduce)");

export class Player {
  constructor(store) {
    this.store = store;
    this.t = 0;
    this.rate = 20;
    this.playing = false;
    this.following = true;
  }

  begin() {
    this.t = 0;
    this.playing = false;
    this.following = true;
  }

  seek(t) {
    this.following = false;
    this.t = Math.min(Math.max(t, this.store.startS), this.store.lastS);
  }

  follow() {
    this.following = true;
    this.playing = false;
  }

  toggle() {
    if (this.playing || this.following) {
      this.playing = this.following = false;
      return;
    }
    if (this.t >= this.store.lastS) this.t = this.store.startS;
    this.playing = true;
  }

  // Advances by seconds of wall clock.
  advance(elapsedS) {
    const last = this.store.lastS;
    if (this.following) {
      const behind = last - this.t;
      this.t = CALM.matches || behind > 120 || behind < 0.05 ? last : this.t + behind * Math.min(1, elapsedS * 4);
    } else if (this.playing) {
      this.t = Math.min(last, this.t + elapsedS * this.rate);
      if (this.t >= last && !this.growing) this.playing = false;
    }
  }
}
