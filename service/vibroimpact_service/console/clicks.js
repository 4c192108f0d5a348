// A short sound for every impact, louder for faster ones; silent until it is asked for.

export class Clicks {
  constructor() {
    /** @type {AudioContext | null} */
    this.context = null;
    this.fastest = 0;
  }

  /** @param {boolean} on */
  enable(on) {
    if (on) this.context = this.context || new AudioContext();
    else if (this.context) {
      this.context.close();
      this.context = null;
    }
  }

  /** @param {number} speed */
  click(speed) {
    const { context } = this;
    if (!context) return;
    this.fastest = Math.max(this.fastest, speed);
    const now = context.currentTime;
    const tone = context.createOscillator();
    const volume = context.createGain();
    tone.type = "triangle";
    tone.frequency.setValueAtTime(900, now);
    tone.frequency.exponentialRampToValueAtTime(300, now + 0.05);
    volume.gain.setValueAtTime(0.02 + 0.25 * (speed / (this.fastest || 1)), now);
    volume.gain.exponentialRampToValueAtTime(0.001, now + 0.07);
    tone.connect(volume).connect(context.destination);
    tone.start(now);
    tone.stop(now + 0.08);
  }
}
