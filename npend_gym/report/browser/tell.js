// What is told of the motion.

/** Numbers, diagram and table follow the motion; the sentence, which is read out, changes seldom. */
const tell = {
  completed: -1, sentence: "", spoken: -Infinity,
  reset() { [this.completed, this.spoken] = [-1, -Infinity]; },
  show() {
    const energy = chain.output("ENERGY"), error = Math.abs(chain.output("ENERGY_ERROR"));
    $("clock").textContent = `${chain.output("TIME").toFixed(2)} s`;
    $("energy").textContent = `${energy.toPrecision(4)} J`;
    $("error").textContent = pull || turn ? "\u2013" : error.toExponential(0);
    $("pace").textContent = slow ? "slower than chosen: too much to compute" : "";
    const completed = chain.output("BOBS_COMPLETED"), centre = chain.output("PSEUDO_PERIOD_COM");
    const free = !pull && !turn; // what is measured is free motion alone
    const known = free ? completed + (centre > 0 ? 0.5 : 0) : -2;
    if (known !== this.completed) {
      this.completed = known;
      $("measured").hidden = motor !== null;
      const periods = Array.from(chain.periods, (period) => (free && period) || 0);
      const measured = { name: "centre of mass", color: "pink", style: "dashed", value: free ? centre : 0 };
      showPeriods(periods, [measured, ...this.models()]);
    }
    const now = performance.now();
    if (now - this.spoken > 2000) {
      this.spoken = now;
      this.say(this.text());
    }
  },
  say(text) {
    if (text !== this.sentence) $("status").textContent = this.sentence = text;
  },
  text() {
    const { n } = chain, done = chain.output("BOBS_COMPLETED");
    if (turn) return chain.cart === null ? `A motor turns ${plural(n, "pendulum")} at the pivot.` : "A motor pushes the cart.";
    if (pull?.bob < 0) return "The cart is pulled.";
    if (pull) return `Bob ${pull.bob + 1} of ${n} is pulled.`;
    if (motor && upright) return `${plural(n, "rod")} stand upright. Pull a bob, and see whether they get up again.`;
    if (motor) return `A network swings up ${plural(n, "rod")} by the motor at the pivot.`;
    const act = (player.playing ? "swing" : "rest") + (n === 1 ? "s" : "");
    if (done === 0) return `${plural(n, "pendulum")} ${act}; no bob has completed its pseudo-period.`;
    return `${completion(done, n)}, mean pseudo-period ${seconds(chain.output("PSEUDO_PERIOD"))}.`;
  },
  /** The models of the release that is shown, if it is one that they are of. */
  models() {
    const { n, gravity } = chain, byHand = ["damping", "lengths", "masses"];
    const apply = given || (gravity > 0 && byHand.every((id) => value(id) === 0));
    if (motor || pull || turn || released === null || !apply) return [];
    const { limits, factors, each } = models, factor = factors[value("angle")];
    return each.map(({ limit, bends, ...look }) => {
      const period = limits[limit][given ? 0 : n - 1] * (bends ? factor : 1);
      return { ...look, value: period / Math.sqrt(gravity) };
    });
  },
};

const UNITS = {
  n: (n) => plural(n, "pendulum"), angle: (angle) => `${angle}\u00b0`, gravity: (g) => `${g.toFixed(2)} m/s\u00b2`,
  damping: (d) => `${d.toFixed(2)} N m s`, lengths: (power) => `\u00d7 ${(2 ** power).toPrecision(2)}`,
  masses: (power) => `\u00d7 ${(2 ** power).toPrecision(2)}`,
};

const jointName = (joint) => (joint > 0 ? `bob ${joint}` : chain.cart === null ? "the pivot" : "the cart");

function showValues() {
  for (const [id, write] of Object.entries(UNITS)) {
    const text = write(value(id));
    $(`${id}-value`).textContent = text;
    $(id).setAttribute("aria-valuetext", text.replace("\u00d7", "times"));
  }
  sayAngles();
  const choice = chosen === null ? "" : `; ${jointName(chosen)} is chosen`;
  $("chain").setAttribute("aria-label", `${plural(chain.n, "pendulum")}${choice}`);
}

function showMotor() {
  for (const input of document.querySelectorAll("input[name=motor]"))
    input.checked = Number(input.value) === (motor?.n ?? 0);
  player.redraw();
}

function play(on) {
  tell.spoken = -Infinity;
  player.play(on);
}
