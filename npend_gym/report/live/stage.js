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

  color(share) {
    const at = 2 * share, k = Math.min(Math.floor(at), 1);
    return `rgb(${this.ramp[k].map((low, c) => Math.round(low + (at - k) * (this.ramp[k + 1][c] - low)))})`;
  }

  draw(chain, { chosen, pull, action }) {
    const pen = this.canvas.getContext("2d"), { n } = chain, places = chain.places();
    const reach = SHARE * Math.min(this.width, this.height), scale = reach / chain.totalLength;
    const at = (x, y) => [this.width / 2 + x, this.height / 2 - y];
    const joint = (i) => at(places[2 * i] * scale, places[2 * i + 1] * scale);
    const disc = (place, radius, color) => {
      pen.fillStyle = color;
      pen.beginPath();
      pen.arc(...place, radius, 0, 2 * Math.PI);
      pen.fill();
    };
    const line = (points, color, lineWidth) => {
      Object.assign(pen, { strokeStyle: color, lineWidth, lineJoin: "round", lineCap: "round" });
      pen.beginPath();
      points.forEach((point) => pen.lineTo(...point));
      pen.stroke();
    };
    const ring = (place, radius, lineWidth) => {
      Object.assign(pen, { strokeStyle: this.ink, lineWidth });
      pen.beginPath();
      pen.arc(...place, radius, 0, 2 * Math.PI);
      pen.stroke();
    };
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.clearRect(0, 0, this.width, this.height);
    pen.globalAlpha = 0.2;
    ring(at(0, 0), reach, 1);
    pen.globalAlpha = 0.5;
    line(this.trace.map(([x, y]) => at(x * reach, y * reach)), this.tip, 2);
    pen.globalAlpha = 1;
    const radius = Math.min(9, Math.max(2.2, (0.35 * reach) / n));
    if (action) this.drawMotor(pen, at(0, 0), action);
    line(Array.from({ length: n + 1 }, (_, i) => joint(i)), this.ink, n > 60 ? 2 : 1.5);
    for (let bob = 0; bob < n; bob++) disc(joint(bob + 1), radius, this.color(bob / n));
    disc(joint(n), Math.max(radius + 1, 5), this.tip);
    for (const [x, y] of this.marks.values()) disc(at(x * reach, y * reach), Math.max(1.5, 0.4 * radius), this.ink);
    if (pull) line([joint(pull.bob + 1), at(pull.x * scale, pull.y * scale)], this.ink, 1);
    if (chosen !== null) ring(joint(chosen + 1), radius + 5, 2);
    disc(at(0, 0), 3.5, this.ink);
  }

  /** An arc around the pivot: as long as the torque is large. */
  drawMotor(pen, place, action) {
    Object.assign(pen, { strokeStyle: this.tip, lineWidth: 5, lineCap: "round" });
    pen.beginPath();
    pen.arc(...place, 16, Math.PI / 2, Math.PI / 2 - action * Math.PI, action > 0);
    pen.stroke();
  }
}
