"use strict";
// What the pictures of chains are drawn with. Places are [x, y] in pixels.

class Pen {
  /** Of a canvas that is `ratio` times as fine as the pixels of places; the picture is empty. */
  constructor(canvas, ratio) {
    this.pen = canvas.getContext("2d");
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.pen.clearRect(0, 0, canvas.width, canvas.height);
  }

  /** Draw with this share of the colour from here on. */
  fade(share) {
    this.pen.globalAlpha = share;
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

/** Colour at a share of the way along three. */
function blend(colors, share) {
  const at = 2 * share, k = Math.min(Math.floor(at), 1);
  return `rgb(${colors[k].map((low, c) => Math.round(low + (at - k) * (colors[k + 1][c] - low)))})`;
}
