// What moves the chain: time, a network, and the reader, who pulls its bobs or poses it.

const { physics, models } = data, { task } = physics, given = data.chain;

const TICK = task.dt / Math.round(task.dt * 120); // s, of the motion
const BUDGET = 11; // ms of computation in a picture's 16; beyond it time runs slower than chosen
const TOUCH = 44; // pixels within which a bob is grabbed
const MAX_PARTS = 64; // of a tick, while a bob is pulled
const TURN = 0.25; // of the lifting energy [N m]: the torque by keys, half of what holds the chain level
const PUSH = 0.5; // of the weight, with that of the cart: the force by keys on a cart
const TRACE = 360; // places of the tip, in ticks
const reduced = matchMedia("(prefers-reduced-motion: reduce)").matches;

if (!globalThis.WebAssembly || !globalThis.DecompressionStream)
  $("status").textContent = "This browser is too old: the pendulums need WebAssembly and DecompressionStream.";
const module = await unpacked(data.module);
const [chain, second] = [await Chain.load(module, data.layout, physics), await Chain.load(module, data.layout, physics)];
const policies = new Map(), weights = await unpacked(data.weights);
let end = 0;
for (const one of data.policies) {
  const policy = new Policy(one, weights, end);
  policies.set(one.n, policy);
  end = policy.end;
}
const stage = new Stage($("chain"), data.palette);
const player = new Player(run, () => {
  drawChain();
  tell.show();
});

let owed = 0, ticked = 0, slow = false;
let motor = null; // the policy that acts, if any
let action = 0; // its last
let turn = 0; // torque at the pivot by keys, or force on the cart, -1, 0 or 1
let pull = null; // {bob, x, y}: a bob, or the cart, -1, and where it is pulled to, over the length; {key}: by a key
let chosen = null; // the joint that keys act on: 0 is the pivot or the cart, k is bob k
let released = null; // rad, of the release, while nothing else has moved the chain
let twin = 0; // rad, by which the second chain is turned at the start; 0: there is none
let disturbed = false; // whether a pull or a turn has acted since the measurement began
let upright = false; // whether the network has met its goal for as long as success needs
let trace = []; // of the tip
const marks = new Map(); // where bobs have completed

const bounded = (x) => Math.min(Math.max(x, -1e4), 1e4); // beyond, turns are lost in the rounding
const value = (id) => bounded(Number($(id).value));
const parameters = () => given ?? byHand();
const byHand = () => {
  const n = value("n"), along = (k) => (n > 1 ? k / (n - 1) - 0.5 : 0);
  const spread = (id) => {
    const shares = Array.from({ length: n }, (_, k) => 2 ** (value(id) * along(k)));
    const mean = shares.reduce((sum, share) => sum + share, 0) / n;
    return shares.map((share) => share / mean); // 1 m and 1 kg on average
  };
  const damping = new Array(n).fill(value("damping"));
  return { masses: spread("masses"), lengths: spread("lengths"), gravity: value("gravity"), damping };
};
const radians = () => (value("angle") / 180) * Math.PI;

function begin(theta, omega, place = 0, speed = 0) {
  chain.begin(parameters(), theta, omega, place, speed);
  chain.base.torque.fill(0);
  twin = (value("twin") / 180) * Math.PI;
  if (twin) second.begin(parameters(), theta.map((angle) => angle + twin), omega, place, speed);
  [trace, rows] = [[], []];
  marks.clear();
  [owed, ticked, upright, disturbed, action] = [0, 0, false, false, 0];
  tell.reset();
  record();
  player.redraw();
}

function release() {
  const theta = written(), alike = theta.every((angle) => angle === radians());
  [motor, pull, turn, chosen, stage.middle] = [null, null, 0, null, 0];
  released = alike ? radians() : null;
  begin(theta, theta.map(() => 0));
  showValues();
  showMotor();
}

/** Go on from the present state, measuring anew. */
function goOn() {
  released = null;
  begin(Array.from(chain.theta), Array.from(chain.omega), chain.place, chain.speed);
}

/** Let a network of the package swing up its chain from near rest. */
function swing(n) {
  for (const [id, at] of Object.entries({ n, gravity: physics.gravity, damping: 0, lengths: 0, masses: 0 }))
    $(id).value = at;
  $("angles").value = "";
  const near = () => Array.from({ length: n }, () => (2 * Math.random() - 1) * task.spread);
  [motor, pull, turn, released, chosen] = [policies.get(n), null, 0, null, null];
  begin(near(), near());
  showValues();
  showMotor();
}

function tick() {
  const { torque } = chain.base, every = Math.round(task.dt / TICK);
  if (motor && ticked % every === 0) action = motor.act(chain.observation);
  ticked += 1;
  disturbed ||= Boolean(pull || turn);
  const limit = task.torque * chain.liftingEnergy;
  const parts = pull ? pullParts() : 1;
  for (let part = 0; part < parts; part++) {
    torque.fill(0);
    if (chain.cart === null) torque[0] = (motor ? limit * action : 0) + TURN * turn * chain.liftingEnergy;
    else torque[chain.n] = PUSH * turn * weight();
    if (pull) addPull();
    if (twin) {
      second.base.torque.set(torque);
      second.advance(TICK / parts);
    }
    chain.advance(TICK / parts);
  }
  upright = motor && !pull && !turn && chain.flag("SUCCESS");
  follow();
  record();
  if (chain.flag("DIVERGED")) release();
}

/** Remember where the tip is and, in free motion, where bobs have completed. */
function follow() {
  const joints = chain.joints();
  if (!reduced) trace.push(joints[chain.n]);
  if (trace.length > TRACE) trace.shift();
  for (let bob = 0; bob < chain.n; bob++)
    if (!motor && !pull && !turn && chain.periods[bob] > 0 && !marks.has(bob)) marks.set(bob, joints[bob + 1]);
}

function drawChain() {
  stage.draw({
    joints: chain.joints(), centres: chain.centres, trace, marks: [...marks.values()], chosen,
    onCart: chain.cart !== null,
    torque: (motor ? action : 0) || turn,
    held: pull && pull.bob + 1, hand: pull && [pull.x, pull.y], second: twin ? second.joints() : [],
  });
}

const weight = () => chain.totalMass * (chain.gravity || physics.gravity); // [N]

/** A damped spring from the bob to the pointer: 1/30 of the chain's length bears its weight. */
function spring() {
  const { totalLength, totalMass } = chain, stiffness = (30 * weight()) / totalLength;
  return { stiffness, damping: Math.sqrt(stiffness * totalMass), most: 12 * weight() };
}

function pullParts() { // the force is held for a part of a tick, in which it must not brake too much
  const rate = spring().damping / chain.lightest;
  return Math.min(MAX_PARTS, Math.max(1, Math.ceil((rate * TICK) / 0.2)));
}

function addPull() {
  const { stiffness, damping, most } = spring(), velocity = chain.velocity(pull.bob);
  const at = chain.joints()[pull.bob + 1], away = [pull.x - at[0], pull.y - at[1]];
  const force = away.map((to, c) => stiffness * chain.totalLength * to - damping * velocity[c]);
  const size = Math.hypot(...force), share = size > most ? most / size : 1;
  chain.push(pull.bob, share * force[0], share * force[1]);
}

/** Bend the chain so that a bob comes to a place, the rods below it keeping their directions; or move the cart. */
function pose(bob, x, y) {
  if (bob < 0) return rest(Array.from(chain.theta), x * chain.totalLength);
  const points = chain.joints().slice(0, bob + 2), theta = Array.from(chain.theta);
  const lengths = Array.from(chain.lengths, (length) => length / chain.totalLength);
  const towards = (from, to, length) => { // the point at a distance from one, in the direction of another
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]], far = Math.hypot(dx, dy) || 1;
    return [from[0] + (dx * length) / far, from[1] + (dy * length) / far];
  };
  for (let round = 0; round < 40; round++) { // from the bob to the pivot and back (FABRIK)
    points[bob + 1] = [x, y];
    for (let i = bob; i > 0; i--) points[i] = towards(points[i + 1], points[i], lengths[i]);
    for (let i = 0; i <= bob; i++) points[i + 1] = towards(points[i], points[i + 1], lengths[i]);
  }
  for (let i = 0; i <= bob; i++) {
    const angle = Math.atan2(points[i + 1][0] - points[i][0], points[i][1] - points[i + 1][1]);
    theta[i] = angle + 2 * Math.PI * Math.round((theta[i] - angle) / (2 * Math.PI));
  }
  rest(theta);
}

/** Let the chain be at rest at these angles. */
function rest(theta, place = chain.place) {
  released = null;
  begin(theta, new Array(chain.n).fill(0), place);
}

function letGo() {
  if (!pull && !turn) return;
  [pull, turn] = [null, 0];
  if (disturbed && !motor) goOn();
  tell.spoken = -Infinity; // nothing is pulled any more
  player.redraw();
}

/** Let `seconds` pass. */
function run(seconds) {
  const start = performance.now();
  for (owed += seconds; owed >= TICK; owed -= TICK) {
    tick();
    slow = performance.now() - start > BUDGET;
    if (slow) owed = Math.min(owed, TICK);
  }
}
