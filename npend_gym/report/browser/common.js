// What all pages share: their data, time that passes, keys, dark and light.

const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const plural = (n, word) => `${n} ${word}${n === 1 ? "" : "s"}`;
const seconds = (value) => `${value.toFixed(4)} s`;

/** Time that passes while it plays, and pictures: none are drawn where nothing changes. */
class Player {
  /** `advance` takes seconds of the motion, `draw` shows its present state. */
  constructor(advance, draw) {
    Object.assign(this, { advance, draw, playing: false, last: 0, waiting: false });
  }

  play(on) {
    if (on && !this.playing) this.last = performance.now();
    this.playing = on;
    $("play").textContent = on ? "Pause" : "Play";
    this.redraw();
  }

  /** Draw once the browser is ready for a picture. */
  redraw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.waiting = false;
    if (this.playing) {
      const passed = Math.min(Math.max(0, now - this.last), 100) / 1000;
      this.last = now;
      this.advance(passed * Number($("speed").value));
    }
    this.draw();
    if (this.playing) this.redraw();
  }
}

/** Let keys of an element act; those of a button, a menu or a slider within it are their own. */
function onKeys(element, actions) {
  element.onkeydown = (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.target.closest("button, select, input, summary")) return;
    const act = actions[event.key];
    if (!act) return;
    event.preventDefault();
    if (!event.repeat || !/^[ a-z]$/i.test(event.key)) act();
  };
}

/** Draw anew where the size of the picture, or dark and light, change; a button changes them too. */
function followLooks(stage, redraw) {
  const again = () => {
    stage.fit();
    redraw();
  };
  const system = matchMedia("(prefers-color-scheme: dark)"), root = document.documentElement.style;
  system.onchange = again;
  new ResizeObserver(again).observe(stage.canvas);
  if ($("theme")) $("theme").onclick = () => {
    const scheme = root.colorScheme || (system.matches ? "dark" : "light");
    root.colorScheme = scheme === "dark" ? "light" : "dark";
    again();
  };
}
