// The picture of the chain.

const SHARE = 0.46; // of the canvas that the straight chain reaches from the middle
const TRACE = 360; // places of the tip, in ticks

class Stage {
  constructor(canvas, { ramp, tip }, reducedMotion) {
    Object.assign(this, { canvas, ramp, tip, reducedMotion, trace: [], marks: new Map() });
    this.fit();
  }

  /** Take the size that the page gives the canvas. */
  fit() {
    this.ratio = Math.min(devicePixelRatio || 1, 2);
    [this.width, this.height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    this.canvas.width = Math.round(this.width * this.ratio);
    this.canvas.height = Math.round(this.height * this.ratio);
    this.ink = getComputedStyle(this.canvas).color;
  }

  /** Place [m] of a point of the canvas [pixels], for a chain that is `length` long. */
  place([x, y], length) {
    const scale = (SHARE * Math.min(this.width, this.height)) / length;
    return [(x - this.width / 2) / scale, (this.height / 2 - y) / scale];
  }

  clear() {
    this.trace = [];
    this.marks.clear();
  }

  /** Remember where the tip is and, where bobs are `measured`, where they have completed. */
  follow(chain, measured) {
    const places = chain.places(), { n } = chain, scale = 1 / chain.totalLength;
    if (!this.reducedMotion) this.trace.push([places[2 * n] * scale, places[2 * n + 1] * scale]);
    if (this.trace.length > TRACE) this.trace.shift();
    for (let bob = 0; bob < n; bob++)
      if (measured && chain.periods[bob] > 0 && !this.marks.has(bob))
        this.marks.set(bob, [places[2 * bob + 2] * scale, places[2 * bob + 3] * scale]);
  }

  draw(chain, { chosen, pull, action }) {
    const pen = new Pen(this.canvas, this.ratio), { n } = chain, places = chain.places();
    const reach = SHARE * Math.min(this.width, this.height), scale = reach / chain.totalLength;
    const at = (x, y) => [this.width / 2 + x, this.height / 2 - y];
    const joint = (i) => at(places[2 * i] * scale, places[2 * i + 1] * scale);
    pen.fade(0.2);
    pen.ring(at(0, 0), reach, this.ink, 1);
    pen.fade(0.5);
    pen.line(this.trace.map(([x, y]) => at(x * reach, y * reach)), this.tip, 2);
    pen.fade(1);
    const radius = Math.min(9, Math.max(2.2, (0.35 * reach) / n));
    if (action) // an arc around the pivot, as long as the torque is large
      pen.ring(at(0, 0), 16, this.tip, 5, Math.PI / 2, Math.PI / 2 - action * Math.PI, action > 0);
    pen.line(Array.from({ length: n + 1 }, (_, i) => joint(i)), this.ink, n > 60 ? 2 : 1.5);
    for (let bob = 0; bob < n; bob++) pen.disc(joint(bob + 1), radius, blend(this.ramp, bob / n));
    pen.disc(joint(n), Math.max(radius + 1, 5), this.tip);
    for (const [x, y] of this.marks.values()) pen.disc(at(x * reach, y * reach), Math.max(1.5, 0.4 * radius), this.ink);
    if (pull) pen.line([joint(pull.bob + 1), at(pull.x * scale, pull.y * scale)], this.ink, 1);
    if (chosen !== null) pen.ring(joint(chosen + 1), radius + 5, this.ink, 2);
    pen.disc(at(0, 0), 3.5, this.ink);
  }
}
