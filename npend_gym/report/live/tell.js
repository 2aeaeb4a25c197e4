// What is told of the motion.

const plural = (n, word) => `${n} ${word}${n === 1 ? "" : "s"}`;

/** Numbers, diagram and table follow the motion; the sentence, which is read out, changes seldom. */
const tell = {
  completed: -1, sentence: "", spoken: -Infinity,
  reset() { [this.completed, this.spoken] = [-1, -Infinity]; },
  show() {
    const energy = chain.output("ENERGY"), error = Math.abs(chain.output("ENERGY_ERROR"));
    $("clock").textContent = `${chain.output("TIME").toFixed(2)} s`;
    $("energy").textContent = `${energy.toPrecision(4)} J`;
    $("error").textContent = pull ? "\u2013" : error.toExponential(0);
    $("pace").textContent = slow ? "slower than told: too much to compute" : "";
    const completed = chain.output("BOBS_COMPLETED"), centre = chain.output("PSEUDO_PERIOD_COM");
    const known = pull ? -2 : completed + (centre > 0 ? 0.5 : 0);
    if (known !== this.completed) {
      this.completed = known;
      if (pull) this.periods(new Array(chain.n).fill(0), 0); // known are those of free motion alone
      else this.periods(Array.from(chain.periods, (period) => period || 0), centre);
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
    if (pull) return `Bob ${pull.bob + 1} of ${n} is pulled.`;
    if (motor && upright) return `${plural(n, "rod")} stand upright. Pull a bob, and see whether they get up again.`;
    if (motor) return `A network swings up ${plural(n, "rod")} by the motor at the pivot.`;
    if (done === 0) return `${plural(n, "pendulum")} ${running ? "swing" : "rest"}; no bob has completed its pseudo-period.`;
    return `${done} of ${plural(n, "bob")} ${done === 1 ? "has" : "have"} completed, mean pseudo-period ${seconds(chain.output("PSEUDO_PERIOD"))}.`;
  },
  periods(periods, centre) {
    const known = !motor && !pull && released !== null && isUniform() && value("gravity") > 0 && value("damping") === 0;
    const degrees = Math.round(value("angle"));
    const law = known ? data.law[chain.n - 1] * data.factor[degrees] / Math.sqrt(value("gravity")) : null;
    $("measured").hidden = motor !== null;
    this.plot(periods, centre, law);
    $("table").tBodies[0].replaceChildren(...periods.map((period, k) => {
      const row = document.createElement("tr"), head = document.createElement("th");
      Object.assign(head, { scope: "row", textContent: k + 1 });
      row.append(head, Object.assign(document.createElement("td"), { textContent: period > 0 ? period.toFixed(4) : "\u2013" }));
      return row;
    }));
  },
  plot(periods, centre, law) {
    const { n } = chain, series = [];
    const add = (name, color, style, at) =>
      at > 0 && series.push({ ...level(name, color, style, at, n), name: `${name}: ${seconds(at)}` });
    add("centre of mass", "pink", "", centre);
    add("law T(N,a)", "orange", "dashed", law);
    const points = periods.map((period, k) => ({ x: k + 1, y: period, text: `bob ${k + 1}: ${seconds(period)}` }));
    const known = points.filter(({ y }) => y > 0);
    series.push({ name: "bobs", color: "blue", kind: "points", style: n > 40 ? "small" : "", points: known });
    const x = { label: "bob, from the pivot", low: 0.5, high: n + 0.5, whole: true };
    const y = { label: "pseudo-period [s]", low: 0, high: 1.12 * Math.max(...periods, centre, law ?? 1) };
    plot($("periods"), `Pseudo-period of each of ${plural(n, "bob")}`, x, y, series);
  },
};

const UNITS = {
  n: (n) => plural(n, "pendulum"), angle: (angle) => `${angle}\u00b0`, gravity: (g) => `${g.toFixed(2)} m/s\u00b2`,
  damping: (d) => `${d.toFixed(2)} N m s`, lengths: (power) => `\u00d7 ${(2 ** power).toPrecision(2)}`,
  masses: (power) => `\u00d7 ${(2 ** power).toPrecision(2)}`,
};

function showValues() {
  for (const [id, write] of Object.entries(UNITS)) {
    const text = write(value(id));
    $(`${id}-value`).textContent = text;
    $(id).setAttribute("aria-valuetext", text.replace("\u00d7", "times"));
  }
  $("chain").setAttribute("aria-label", `${plural(value("n"), "pendulum")}${chosen === null ? "" : `; bob ${chosen + 1} is chosen`}`);
}

function showMotor() {
  for (const input of document.querySelectorAll("input[name=motor]"))
    input.checked = Number(input.value) === (motor?.n ?? 0);
  dirty = true;
}

function play(on) {
  running = on;
  $("play").textContent = on ? "Pause" : "Run";
  tell.spoken = -Infinity;
  dirty = true;
}
