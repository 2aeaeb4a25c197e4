// The picture of a chain.

const SHARE = 0.46; // of the canvas that the straight chain reaches from the middle
const ROOM = 0.6; // over the chain's length: from here on the picture follows a cart

/** Colour at a share of the way along three. */
function blend(colors, share) {
  const at = 2 * share, k = Math.min(Math.floor(at), 1);
  return `rgb(${colors[k].map((low, c) => Math.round(low + (at - k) * (colors[k + 1][c] - low)))})`;
}

class Stage {
  constructor(canvas, { ramp, tip }) {
    Object.assign(this, { canvas, ramp, tip, pen: canvas.getContext("2d"), middle: 0 });
    this.fit();
  }

  /** Take the size and the colour that the page gives the canvas. */
  fit() {
    this.ratio = Math.min(devicePixelRatio || 1, 2);
    [this.width, this.height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    this.canvas.width = Math.round(this.width * this.ratio);
    this.canvas.height = Math.round(this.height * this.ratio);
    this.reach = SHARE * Math.min(this.width, this.height); // pixels of the chain's length
    const { color, backgroundColor } = getComputedStyle(this.canvas);
    [this.ink, this.paper] = [color, backgroundColor];
  }

  /** Place, over the chain's length, of a point of the canvas [pixels]. */
  place([x, y]) {
    return [this.middle + (x - this.width / 2) / this.reach, (this.height / 2 - y) / this.reach];
  }

  pixel([x, y]) {
    return [this.width / 2 + this.reach * (x - this.middle), this.height / 2 - this.reach * y];
  }

  /**
   * Draw a chain. Places are [x, y] from the pivot over the chain's length, y upwards: of the n + 1
   * `joints`, of the `trace` of the tip, and of `marks`. Links with `centres` of mass, shares of
   * their lengths, are bars. `torque` at the pivot, or the force on a cart, is from -1 to 1; joint
   * `chosen` gets a ring, and joint `held` a line to `hand`. `second` has the joints of another
   * chain, if any.
   */
  draw({ joints, centres, trace, marks, torque = 0, chosen = null, held = null, hand, second = [], onCart = false }) {
    this.middle = Math.min(joints[0][0] + ROOM, Math.max(joints[0][0] - ROOM, this.middle));
    this.pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    this.pen.clearRect(0, 0, this.width, this.height);
    this.pen.fillStyle = this.paper; // a film has no transparency
    this.pen.fillRect(0, 0, this.width, this.height);
    const at = joints.map((place) => this.pixel(place)), n = joints.length - 1;
    const radius = Math.min(9, Math.max(2.2, (0.35 * this.reach) / n));
    this.pen.globalAlpha = 0.2;
    if (onCart) this.drawRail();
    else this.ring(at[0], this.reach, this.ink, 1);
    this.pen.globalAlpha = 0.5;
    this.line(trace.map((place) => this.pixel(place)), this.tip, 2);
    const other = second.map((place) => this.pixel(place));
    this.line(other, this.ink, 3);
    for (const place of other) this.disc(place, radius, this.ink);
    if (second.length && onCart) this.drawCart(other[0]);
    this.pen.globalAlpha = 1;
    if (onCart) this.drawCart(at[0], torque);
    else if (torque) // an arc around the pivot, as long as the torque is large
      this.ring(at[0], 16, this.tip, 5, Math.PI / 2, Math.PI / 2 - torque * Math.PI, torque > 0);
    if (centres.length === 0) this.drawBobs(at, radius);
    else this.drawLinks(at, radius, centres);
    for (const place of marks) this.disc(this.pixel(place), Math.max(1.5, 0.45 * radius), this.ink);
    if (held !== null) this.line([at[held], this.pixel(hand)], this.ink, 1);
    if (chosen !== null) this.ring(at[chosen], radius + 5, this.ink, 2);
    this.disc(at[0], 3.5, this.ink);
  }

  /** Draw the rail of a cart, with a mark at every length of the chain. */
  drawRail() {
    const [left, right] = [0, this.width].map((x) => this.place([x, 0])[0]);
    this.line([[0, this.height / 2], [this.width, this.height / 2]], this.ink, 2);
    for (let x = Math.ceil(left); x <= right; x++)
      this.line([0, -0.04].map((y) => this.pixel([x, y])), this.ink, 2);
  }

  /** Draw a cart, with a bar as long as the force is large. */
  drawCart([x, y], force = 0) {
    const [width, height] = [0.22 * this.reach, 0.09 * this.reach];
    this.pen.fillStyle = this.ink;
    this.pen.fillRect(x - width / 2, y - height / 2, width, height);
    const side = x + (Math.sign(force) * width) / 2;
    this.line([[side, y], [side + 0.5 * force * width, y]], this.tip, 5);
  }

  drawBobs(joints, radius) {
    const n = joints.length - 1;
    this.line(joints, this.ink, n > 60 ? 2 : 1.5);
    for (let bob = 0; bob < n; bob++) this.disc(joints[bob + 1], radius, blend(this.ramp, bob / n));
    this.disc(joints[n], Math.max(radius + 1, 5), this.tip);
  }

  /** Draw bars, each with a dot at its centre of mass, which may lie on an arm beyond a joint. */
  drawLinks(joints, radius, centres) {
    const n = centres.length, middles = centres.map((share, link) =>
      [0, 1].map((c) => joints[link][c] + share * (joints[link + 1][c] - joints[link][c])));
    middles.forEach((middle, link) => {
      const color = link === n - 1 ? this.tip : blend(this.ramp, link / n);
      this.line([joints[link], middle], this.ink, radius / 2);
      this.line([joints[link], joints[link + 1]], color, 1.6 * radius);
    });
    for (const middle of middles) this.disc(middle, radius / 2, this.ink);
    for (const joint of joints.slice(0, -1)) this.disc(joint, radius / 3, "white");
  }

  disc(place, radius, color) {
    this.pen.fillStyle = color;
    this.pen.beginPath();
    this.pen.arc(...place, radius, 0, 2 * Math.PI);
    this.pen.fill();
  }

  line(points, color, lineWidth) {
    this.stroke(color, lineWidth, () => points.forEach((point) => this.pen.lineTo(...point)));
  }

  /** An arc from one angle to another, or a circle. */
  ring(place, radius, color, lineWidth, from = 0, to = 2 * Math.PI, backwards = false) {
    this.stroke(color, lineWidth, () => this.pen.arc(...place, radius, from, to, backwards));
  }

  stroke(strokeStyle, lineWidth, draw) {
    Object.assign(this.pen, { strokeStyle, lineWidth, lineJoin: "round", lineCap: "round" });
    this.pen.beginPath();
    draw();
    this.pen.stroke();
  }
}
