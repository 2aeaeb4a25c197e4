// The physics: kernels of npend_gym in WebAssembly, on arrays laid out as the package lays them out.

const START = 64; // bytes at address 0 that kernels may write what they return to

/** A chain that hangs from a pivot, or from a cart on a rail; all quantities in SI units. */
class Chain {
  /** Compile the module; `layout` names the rows of its arrays, `physics` has the constants. */
  static async load(module, layout, physics) {
    const memory = new WebAssembly.Memory({ initial: 8 });
    const { instance } = await WebAssembly.instantiate(module, { env: { __linear_memory: memory } });
    return new Chain(instance.exports, memory.buffer, layout, physics);
  }

  constructor(kernels, buffer, layout, physics) {
    Object.assign(this, { kernels, buffer, layout, physics, n: 0, torque: [] });
  }

  /** Make arrays for n rods: `arrays` has their numbers, `handed` what kernels are told of them. */
  allocate(n) {
    const { Member, Rod, Turn, Parameter, Output, Flag, Task, Wiring, Timing, scratchRows, terms } = this.layout;
    const rows = (fields) => Object.keys(fields).length;
    let free = START;
    [this.n, this.arrays, this.handed] = [n, {}, {}];
    const array = (name, shape, type = Float64Array) => {
      const size = shape.reduce((product, length) => product * length, 1);
      const bytes = type.BYTES_PER_ELEMENT, strides = shape.map((_, axis) =>
        shape.slice(axis + 1).reduce((product, length) => product * length, bytes));
      this.arrays[name] = new type(this.buffer, free, size).fill(0);
      this.handed[name] = [0, 0, BigInt(size), BigInt(bytes), free, ...shape.map(BigInt), ...strides.map(BigInt)];
      free += 8 * Math.ceil((size * bytes) / 8);
    };
    array("members", [rows(Member), 1]);
    array("rods", [1, rows(Rod), n + 1]);
    array("record", [1, rows(Turn), n + 1]);
    array("chain", [rows(Parameter), n]);
    array("actions", [0, 1]); // none: `torque` says what acts
    array("observation", [1, 3 * n], Float32Array);
    array("outputs", [rows(Output) + 3 * (n + 1), 1]);
    array("flags", [rows(Flag), 1], Uint8Array);
    array("task", [rows(Task)]);
    array("wiring", [rows(Wiring), n + 1]);
    array("timing", [rows(Timing)]);
    array("scratch", [scratchRows, n + 2]);
    terms.forEach(([fields, columns], k) => array(`terms${k}`, [1, fields, columns]));
    this.model = terms.length ? terms.flatMap((_, k) => this.handed[`terms${k}`]) : 0;
    const all = (field) => this.arrays.rods.subarray(Rod[field] * (n + 1), (Rod[field] + 1) * (n + 1));
    const row = (field) => all(field).subarray(0, n);
    [this.theta, this.omega, this.torque] = [row("THETA"), row("OMEGA"), row("TORQUE")];
    [this.lengths, this.masses] = [row("LENGTH"), row("MASS")];
    this.periods = this.arrays.record.subarray(Turn.PERIOD * (n + 1), Turn.PERIOD * (n + 1) + n);
    this.base = { theta: all("THETA"), omega: all("OMEGA"), torque: all("TORQUE") }; // a cart comes after the rods
    this.observation = this.arrays.observation;
    const { task } = this.arrays, { mode, speedLimit } = this.physics.task;
    this.arrays.wiring.fill(1, Wiring.PER_SPEED * (n + 1));
    [task[Task.MODE], task[Task.PIECES]] = [mode, 1];
    [task[Task.AFTER_SINES], task[Task.AFTER_COSINES], task[Task.AFTER_SPEEDS]] = [n, 2 * n, 3 * n];
    [task[Task.MAX_STEPS], task[Task.SPEED_LIMIT]] = [Infinity, speedLimit];
    task[Task.UPRIGHTNESS] = -Infinity; // no rod is limited
  }

  call(name, ...given) {
    const { members, rods, record } = this.handed;
    const failed = this.kernels[name](0, START / 2, ...members, ...rods, ...[this.model, record, ...given].flat());
    if (failed) throw new Error(`the kernel ${name} failed`);
  }

  /**
   * Give it parameters, named as in the package, and a state; time, work and pseudo-periods begin
   * there. Point masses need the first four; a chain of links has `rate` [1/s], too: see `fastestRate`.
   * One on a cart has its mass `cart`, and `base`; `place` [m] and `speed` [m/s] are those of the cart.
   */
  begin({ masses, lengths, gravity, damping, hasBobs = true, rate, cart = null, base = [], ...others },
    theta, omega, place = 0, speed = 0) {
    if (masses.length !== this.n) this.allocate(masses.length);
    const { Parameter, Member } = this.layout, { n } = this, { chain, members } = this.arrays;
    const simple = { centres: lengths, inertias: [0], friction_speed: [1], gear: [null] };
    const given = { ...simple, ...others, masses, lengths, damping, gravity: [gravity] };
    for (const [name, row] of Object.entries(Parameter)) {
      const values = given[name] ?? [0]; // in JSON an infinite gear ratio is null
      for (let i = 0; i < n; i++) chain[row * n + i] = values[values.length > 1 ? i : 0] ?? Infinity;
    }
    [members[Member.WITH_COM], members[Member.HAS_BOBS], members[Member.STARTING]] = [1, hasBobs ? 1 : 0, 1];
    this.theta.set(theta);
    this.omega.set(omega);
    this.cart = cart;
    if (cart !== null) {
      this.arrays.terms2.set(base);
      [this.base.theta[n], this.base.omega[n]] = [place, speed];
    }
    this.gravity = gravity;
    this.rate = rate ?? this.fastestRate({ masses, lengths, gravity, damping });
    const shares = given.centres.map((centre, i) => centre / lengths[i]);
    this.centres = hasBobs ? [] : shares;
    // the least mass that resists a force across a rod, at its end [kg]
    this.lightest = Math.min(...shares.map((share, i) =>
      masses[i] * share ** 2 + (given.inertias[i] ?? 0) / lengths[i] ** 2), cart ?? Infinity);
    this.call("begin_one", this.handed.chain);
    this.step(0, 0, 0);
  }

  /**
   * A bound [1/s] of the frequencies of all normal modes, by Gershgorin's circles on the matrix of
   * small motions, whose entries are tensions over lengths and masses; and of what damping brakes.
   */
  fastestRate({ masses, lengths, gravity, damping }) {
    let [tension, below, fastest, braking] = [0, 0, 0, 0];
    for (let i = masses.length - 1; i >= 0; i--) {
      tension += masses[i] * (gravity || this.physics.gravity);
      const pull = tension / lengths[i];
      fastest = Math.max(fastest, (2 * (pull + below)) / masses[i]);
      const mobility = 1 / masses[i] + (i > 0 ? 1 / masses[i - 1] : 0);
      const joints = damping[i] + (damping[i + 1] ?? 0);
      braking = Math.max(braking, (4 * mobility * joints) / lengths[i] ** 2);
      below = pull;
    }
    return Math.sqrt(fastest) + braking;
  }

  /** Advance by `dt` under the torques, in as many substeps as the package would take, or a few more. */
  advance(dt, substeps = Math.max(1, Math.ceil((dt * this.rate) / this.physics.phase))) {
    const { Task } = this.layout;
    this.arrays.task[Task.HOLD_STEPS] = Math.ceil(this.physics.task.hold / dt);
    this.step(dt, substeps, 1 / this.physics.rotation);
  }

  step(dt, substeps, perRotation) {
    const { Timing, Member, Task } = this.layout, { timing, members, task } = this.arrays;
    timing.fill(0);
    task[Task.OBSERVES] = substeps === 0 ? 1 : 0;
    [timing[Timing.DT], timing[Timing.SUBSTEPS], timing[Timing.LAST_SUBSTEP]] = [dt, substeps, substeps];
    [timing[Timing.PER_ROTATION], timing[Timing.LAST_GROUP]] = [perRotation, 1];
    members[Member.OBSERVED] = 1;
    const { handed } = this;
    this.call("step_one", handed.actions, handed.observation, handed.outputs, handed.flags,
      handed.task, handed.wiring, 0, 0, 0, handed.timing, handed.scratch); // motors are ideal
  }

  output(name) { return this.arrays.outputs[this.layout.Output[name]]; }
  flag(name) { return this.arrays.flags[this.layout.Flag[name]] !== 0; }

  /** Energy that lifts the hanging chain upright [J]. */
  get liftingEnergy() { return 1 / this.arrays.members[this.layout.Member.PER_ENERGY]; }
  get totalLength() { return 1 / this.arrays.members[this.layout.Member.PER_LENGTH]; }
  /** Kinetic energy of point masses, and of their cart [J]; null for links. */
  get kinetic() {
    if (this.centres.length) return null;
    const square = (_, bob) => this.velocity(bob).reduce((sum, speed) => sum + speed ** 2, 0);
    const ofCart = ((this.cart ?? 0) * this.speed ** 2) / 2;
    return Array.from(this.masses, square).reduce((sum, each, bob) => sum + (this.masses[bob] * each) / 2, ofCart);
  }
  /** Of the chain, with its cart [kg]. */
  get totalMass() { return this.masses.reduce((sum, mass) => sum + mass, this.cart ?? 0); }
  /** Place of the cart from the middle of its rail [m], 0 for a pivot at rest; and its velocity [m/s]. */
  get place() { return this.cart === null ? 0 : this.base.theta[this.n]; }
  get speed() { return this.cart === null ? 0 : this.base.omega[this.n]; }

  /** Places [x, y] of the n + 1 joints over the length of the chain, y upwards; [0, 0] is the pivot at rest. */
  joints() {
    const joints = [[this.place / this.totalLength, 0]], scale = 1 / this.totalLength;
    for (let i = 0; i < this.n; i++) {
      const [x, y] = joints[i], length = scale * this.lengths[i];
      joints.push([x + length * Math.sin(this.theta[i]), y - length * Math.cos(this.theta[i])]);
    }
    return joints;
  }

  /** Velocity of the bob below a rod, counted from 0, or of the cart, -1 [m/s]. */
  velocity(bob) {
    let [x, y] = [this.speed, 0];
    for (let i = 0; i <= bob; i++) {
      const speed = this.lengths[i] * this.omega[i];
      x += speed * Math.cos(this.theta[i]);
      y += speed * Math.sin(this.theta[i]);
    }
    return [x, y];
  }

  /** Add torques at the joints, and the force on a cart, that do what a force [N] on a bob does. */
  push(bob, x, y) {
    if (this.cart !== null) this.base.torque[this.n] += x;
    let torque = 0; // on joint i acts what turns the rods from i on
    for (let i = bob; i >= 0; i--) {
      torque += this.lengths[i] * (x * Math.cos(this.theta[i]) + y * Math.sin(this.theta[i]));
      this.torque[i] += torque;
    }
  }
}
