// A clock that runs from 0 to 1 again and again, or once, in frames of the display.

export class Player {
  /**
   * @param {(place: number, from: number) => void} draw called with where it is, and where it was
   * @param {{seconds: number, again: boolean}} options seconds from 0 to 1; whether it begins again
   */
  constructor(draw, { seconds, again }) {
    this.draw = draw;
    this.seconds = seconds;
    this.again = again;
    this.place = 0;
    this.playing = false;
    this.onState = () => {};
    this.last = 0;
  }

  play() {
    if (this.playing) return;
    if (!this.again && this.place >= 1) this.place = 0;
    this.playing = true;
    this.last = 0;
    requestAnimationFrame((now) => this.#frame(now));
    this.onState();
  }

  pause() {
    this.playing = false;
    this.onState();
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  /** @param {number} place */
  seek(place) {
    const from = this.place;
    this.place = Math.min(Math.max(place, 0), 1);
    this.draw(this.place, from);
  }

  /** @param {number} now */
  #frame(now) {
    if (!this.playing) return;
    const passed = this.last ? now - this.last : 0;
    this.last = now;
    const from = this.place;
    // A page that was hidden goes on where it was.
    this.place += Math.min(passed, 100) / 1000 / this.seconds;
    if (this.place >= 1) {
      if (this.again) this.place %= 1;
      else {
        this.place = 1;
        this.playing = false;
        this.onState();
      }
    }
    this.draw(this.place, from);
    requestAnimationFrame((next) => this.#frame(next));
  }
}

/** @returns {boolean} whether the user asks for less motion */
export function calm() {
  return matchMedia("(prefers-reduced-motion: reduce)").matches;
}
