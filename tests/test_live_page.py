"""The live page: what a browser computes with it, and how it answers to the reader."""

import json
import re

import numpy as np
import pytest
from accessibility import grave_findings
from conftest import wait_for
from scipy.special import ellipk

from npend_gym import Cart, Chain, pseudo_periods, theory
from npend_gym.cli import main
from npend_gym.envs import EnvConfig
from npend_gym.physics import Ensemble
from npend_gym.physics.energy import kinetic_of_motion, potential_energy
from npend_gym.physics.substeps import default_substeps
from npend_gym.rl import Policy

pytestmark = pytest.mark.long  # the first page of a version compiles for a minute

UNEVEN = Chain([1.0, 0.4, 2.0], [0.7, 1.2, 0.5], gravity=3.7, damping=[0.1, 0.02, 0.3])
ON_CART = Chain(UNEVEN.masses, UNEVEN.lengths, damping=0.05, base=Cart(1.5, damping=0.2))
CHAINS = {
    "1": Chain.uniform(1),
    "2": Chain.uniform(2),
    "5": Chain.uniform(5),
    "20": Chain.uniform(20),
    "100": Chain.uniform(100),
    "unequal, damped": UNEVEN,
    "20, damped": Chain.uniform(20, damping=0.2),
}


@pytest.fixture(scope="session")
def path(tmp_path_factory):
    out = tmp_path_factory.mktemp("live") / "live.html"
    assert main(["play", "--out", str(out)]) == 0
    return out


@pytest.fixture
def page(open_page, path):
    return opened(open_page, path)


def opened(open_page, path, **options):
    tab = open_page(path, **options)
    tab.wait_for_selector("body[data-ready]")
    return tab


def page_of(open_page, tmp_path, chain):
    """The page that a chain moves on, and the chain."""
    (tmp_path / "chain.json").write_text(json.dumps(chain.as_dict()))
    out = tmp_path / "live.html"
    assert main(["play", "--chain", str(tmp_path / "chain.json"), "--out", str(out)]) == 0
    return opened(open_page, out), chain


def plain(chain):
    """A chain as the scripts of the page take it."""
    values = chain.as_dict()
    return {name: values[name] for name in ("masses", "lengths", "gravity", "damping")}


# ---- what it computes ----------------------------------------------------------------------------

ADVANCE = """async ([chain, theta, omega, torque, dt, substeps, steps]) => {
  const { npend } = globalThis, { module, layout, physics } = npend.data;
  const live = await npend.Chain.load(await npend.unpacked(module), layout, physics);
  live.begin(chain ?? npend.data.chain, theta, omega);
  const states = [];
  for (let step = 0; step < steps; step++) {
    live.base.torque.set(torque); // and the force on a cart
    if (substeps) live.step(dt, substeps, 0); else live.advance(dt);
    states.push([...live.theta, ...live.omega, live.place, live.speed]);
  }
  const periods = [...live.periods].map((t) => (t > 0 ? t : -1));
  return { states, periods, energy: live.output("ENERGY"), error: live.output("ENERGY_ERROR"),
    centre: live.output("PSEUDO_PERIOD_COM") };
}"""


def advanced(page, chain, start, torque, dt, substeps, steps):
    """What becomes of a chain, or of that which the page was made for."""
    parameters = chain and plain(chain)
    found = page.evaluate(ADVANCE, [parameters, *start, torque, dt, substeps, steps])
    return np.array(found.pop("states")), found


def by_the_package(chain, theta, omega, torque, force=0.0):
    """States and ensemble after 100 steps."""
    ensemble, states = Ensemble(chain, 1, joints=range(chain.n)), []
    ensemble.set_state(0, theta, omega)
    for _ in range(100):
        ensemble.advance(torque[None], 0.02, 40, force=force)
        states.append(np.concatenate([ensemble.theta[0], ensemble.omega[0], *ensemble.cart]))
    return states, ensemble


@pytest.mark.parametrize("name", CHAINS)
def test_a_browser_computes_the_bits_of_the_package(page, name):
    chain = CHAINS[name]
    rng = np.random.default_rng(chain.n)
    theta, omega = rng.uniform(-2.0, 2.0, chain.n), rng.normal(size=chain.n)
    torque = rng.normal(size=chain.n) * 3.0
    start = theta.tolist(), omega.tolist()
    states, found = advanced(page, chain, start, torque.tolist(), 0.02, 40, 100)
    expected, ensemble = by_the_package(chain, theta, omega, torque)
    np.testing.assert_array_equal(states, expected)
    np.testing.assert_array_equal(
        found["periods"], np.nan_to_num(ensemble.pseudo_periods[0], nan=-1.0)
    )
    assert found["energy"] == pytest.approx(ensemble.energy[0], rel=1e-12)


@pytest.mark.parametrize("degrees", [-150.0, 60.0, 120.0])
def test_one_pendulum_has_the_period_of_the_elliptic_integral(page, degrees):
    chain, start = Chain.uniform(1), np.radians(degrees)
    _, found = advanced(page, chain, ([start], [0.0]), [0.0], 0.02, 40, 200)
    small = 2.0 * np.pi / np.sqrt(chain.gravity)
    exact = small * 2.0 / np.pi * ellipk(np.sin(0.5 * start) ** 2)
    assert found["periods"] == pytest.approx([exact], abs=1e-6)
    assert found["centre"] == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize(
    "name",
    [
        *(pytest.param(k, marks=pytest.mark.nightly) for k in ("acrobot", "cartpole")),
        *("realaigym C.1", "uneven"),
    ],
)
def test_a_browser_computes_the_bits_of_links_machines_and_carts(open_page, tmp_path, name):
    page, chain = page_of(open_page, tmp_path, ON_CART if name == "uneven" else Chain.preset(name))
    rng = np.random.default_rng(1)
    theta, omega = rng.uniform(-2.0, 2.0, chain.n), rng.normal(size=chain.n)
    torque = 0.1 * chain.lifting_energy * rng.normal(size=chain.n)
    force = 0.0 if chain.base is None else 3.0
    start = theta.tolist(), omega.tolist()
    states, found = advanced(page, None, start, [*torque.tolist(), force], 0.02, 40, 100)
    expected, ensemble = by_the_package(chain, theta, omega, torque, force)
    np.testing.assert_array_equal(states, expected)
    speed = None if chain.base is None else ensemble.cart[1]
    angles, rates = ensemble.theta, ensemble.omega
    energy = kinetic_of_motion(chain, angles, rates, speed, None, None)
    energy += potential_energy(chain, angles)
    assert found["energy"] == pytest.approx(energy[0], rel=1e-12)
    needed = EnvConfig(chain=chain, dt=1.0, mode="passive").min_substeps  # of a second
    assert page.evaluate("globalThis.npend.chain.rate * 16.0") == pytest.approx(needed)
    assert not page.is_visible("#n")
    before = page.evaluate("[...globalThis.npend.chain.theta]")
    wait_for(page, lambda: page.evaluate("[...globalThis.npend.chain.theta]") != before)


def test_pseudo_periods_are_those_of_the_package(page):
    chain, start = Chain.uniform(5), np.pi / 4
    _, found = advanced(page, chain, ([start] * 5, [0.0] * 5), [0.0] * 5, 1 / 120, None, 600)
    np.testing.assert_allclose(found["periods"], pseudo_periods(chain, start), atol=2e-6)
    assert found["centre"] == pytest.approx(theory.com_period(chain, start).item(), rel=4e-3)
    assert abs(found["error"]) < 1e-8


def test_substeps_are_as_many_as_the_package_takes_or_a_few_more(page):
    rng = np.random.default_rng(0)
    drawn = [
        Chain(
            rng.uniform(0.3, 2, n), rng.uniform(0.3, 2, n), damping=rng.uniform(0, 1, n) * (n % 2)
        )
        for n in (2, 3, 5, 10, 40)
    ]
    for chain in [*CHAINS.values(), Chain.uniform(5, gravity=0.0), *drawn]:
        found = page.evaluate("chain => globalThis.npend.chain.fastestRate(chain)", plain(chain))
        needed = default_substeps(chain, 100.0)
        assert needed <= found * 100.0 * 16.0 + 1 <= 2.0 * needed + 1


SWING_UP = """([n, starts]) => {
  const { chain, policies } = globalThis.npend, policy = policies.get(n);
  const { dt, torque } = chain.physics.task, same = new Array(n).fill(1);
  return starts.map(([theta, omega]) => {
    const { gravity } = chain.physics, damping = same.map(() => 0);
    chain.begin({ masses: same, lengths: same, gravity, damping }, theta, omega);
    for (let step = 0; step < 400; step++) {
      chain.torque[0] = torque * chain.liftingEnergy * policy.act(chain.observation);
      chain.advance(dt);
    }
    return chain.flag("SUCCESS");
  });
}"""


@pytest.mark.parametrize("n", [2, 3, 4])
def test_the_networks_swing_up_in_the_browser_from_every_start(open_page, path, n):
    page = opened(open_page, path, reduced_motion="reduce")  # it stands still meanwhile
    starts = np.random.default_rng(n).uniform(-0.05, 0.05, (48, 2, n)).tolist()
    assert page.evaluate(SWING_UP, [n, starts]) == [True] * 48


@pytest.mark.parametrize("n", [2, 3, 4])
def test_the_networks_act_as_the_policies_of_the_package(page, n):
    policy = Policy.pretrained(f"swingup-{n}")
    observations = np.random.default_rng(n).uniform(-0.2, 0.2, (50, 3 * n)).astype(np.float32)
    run = "([n, all]) => all.map((one) => globalThis.npend.policies.get(n).act(one))"
    found = page.evaluate(run, [n, observations.tolist()])
    np.testing.assert_allclose(found, policy(observations)[:, 0], atol=0.02)


def test_a_finger_pulls_a_bob(open_page, path):
    page = opened(open_page, path, viewport={"width": 390, "height": 844}, has_touch=True)
    page.select_option("#speed", "0.1")
    x, y = pixel_of_bob(page, 5)
    touch = page.context.new_cdp_session(page)

    def send(kind, *points):
        places = [{"x": px, "y": py} for px, py in points]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": places})

    send("touchStart", (x, y))
    send("touchMove", (x - 80.0, y - 30.0))
    page.select_option("#speed", "2")
    wait_for(page, lambda: "Bob 5 of 5 is pulled." in page.text_content("#status"))
    wait_for(page, lambda: np.hypot(*(pixel_of_bob(page, 5) - [x - 80.0, y - 30.0])) < 30.0)
    send("touchEnd")
    wait_for(page, lambda: "pulled" not in page.text_content("#status"))


# ---- the file ------------------------------------------------------------------------------------


def test_the_page_is_one_file_of_200_kb_that_refers_to_nothing_outside(path):
    text = path.read_text("utf-8")
    assert path.stat().st_size < 210_000
    assert set(re.findall(r"https?://[^\"' ]+", text)) == {"http://www.w3.org/2000/svg"}
    assert not re.search(r"<(link|script|img)[^>]+(src|href)=\"(?!data:)", text)


def test_chains_that_the_page_cannot_move_are_refused(refusal, tmp_path):
    file = tmp_path / "chain.json"
    file.write_text(json.dumps(Chain.uniform(2, stiffness=1e3).as_dict()))
    message = refusal("play", "--chain", str(file), "--out", str(tmp_path / "a.html"))
    assert "chain must have no stiffness" in message
    file.write_text(json.dumps(Chain.uniform(300).as_dict()))
    assert "number of links must be between 1 and 200" in refusal("play", "--chain", str(file))


def test_play_opens_what_it_writes_or_says_where_it_is(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or len(opened) < 2)
    assert main(["play"]) == 0
    assert opened == [(tmp_path / "npend-play.html").as_uri()]
    assert main(["play"]) == 1
    assert f"open {tmp_path / 'npend-play.html'} in yours" in capsys.readouterr().err
    assert main(["play", "--out", "other.html"]) == 0
    assert len(opened) == 2
    assert (tmp_path / "other.html").read_bytes() == (tmp_path / "npend-play.html").read_bytes()


# ---- what the reader does ------------------------------------------------------------------------


def slide(page, name, value):
    page.evaluate(
        "([id, value]) => { const slider = document.getElementById(id); slider.value = value;"
        " slider.dispatchEvent(new Event('input')); }",
        [name, value],
    )


def clock(page):
    return float(page.text_content("#clock").split()[0])


def pixel_of_bob(page, bob):
    """Where a bob is on the screen."""
    place = page.evaluate(
        """(bob) => {
          const [x, y] = globalThis.npend.chain.joints()[bob];
          const box = document.getElementById("chain").getBoundingClientRect();
          const scale = 0.46 * Math.min(box.width, box.height);
          return [box.x + box.width / 2 + scale * x, box.y + box.height / 2 - scale * y];
        }""",
        bob,
    )
    return np.array(place)


def test_a_bob_follows_the_pointer_and_is_measured_after_it_is_let_go(page):
    slide(page, "damping", 0.5)
    page.select_option("#speed", "0.1")
    start = pixel_of_bob(page, 5)
    page.mouse.move(*start)
    page.mouse.down()
    goal = start + np.array([-120.0, -40.0])
    page.mouse.move(*goal)
    page.select_option("#speed", "4")
    wait_for(page, lambda: np.hypot(*(pixel_of_bob(page, 5) - goal)) < 60.0)
    wait_for(page, lambda: "is pulled" in page.text_content("#status"))
    page.mouse.up()
    wait_for(page, lambda: clock(page) < 2.0)
    slide(page, "damping", 0.0)
    page.evaluate("document.querySelector('details').open = true")
    wait_for(page, lambda: re.search(r"\d\.\d{4}", page.text_content("#table")) is not None)


@pytest.mark.parametrize("keys", [0, 6], ids=["a pull", "a motor"])
def test_what_is_let_go_in_a_pause_is_measured_from_there(page, keys):
    page.focus("#chain")
    for _ in range(keys):
        page.keyboard.press("ArrowUp")
    page.keyboard.down("ArrowRight")
    start = clock(page)
    wait_for(page, lambda: clock(page) > start + 0.3)  # the pull has acted
    page.keyboard.press("Space")
    page.keyboard.up("ArrowRight")
    wait_for(page, lambda: clock(page) == 0.0)
    names = "all => all.map((one) => one.textContent)"
    assert page.eval_on_selector_all("#measured .legend span", names) == ["bobs"]


def test_one_pendulum_swings_and_rests(page):
    slide(page, "n", 1)
    slide(page, "gravity", 0.0)
    wait_for(page, lambda: page.text_content("#status").startswith("1 pendulum swings; no bob"))
    page.click("#play")
    wait_for(page, lambda: page.text_content("#status").startswith("1 pendulum rests; no bob"))


def test_the_energy_of_heavy_links_is_drawn_between_labels_that_differ(open_page, tmp_path):
    heavy = Chain([20.0, 20.0], [5.0, 5.0], centres=[2.5, 2.5], inertias=[40.0, 40.0])
    page, _ = page_of(open_page, tmp_path, heavy)
    page.evaluate("document.getElementById('lesson').open = true")
    find = "all => all.map((one) => one.textContent)"
    wait_for(page, lambda: len(page.eval_on_selector_all("#energies > text", find)) > 4)
    texts = page.eval_on_selector_all("#energies > text", find)
    up = texts[: texts.index("time [s]")]
    up = up[next(k for k in range(1, len(up)) if float(up[k]) > 100.0) :]
    assert len(set(up)) == len(up) > 1


def test_while_paused_a_bob_stays_where_it_is_put(page):
    page.click("#play")
    start = pixel_of_bob(page, 3)
    page.mouse.move(*start)
    page.mouse.down()
    goal = start + np.array([30.0, -50.0])
    page.mouse.move(*goal)
    page.mouse.up()
    np.testing.assert_allclose(pixel_of_bob(page, 3), goal, atol=1.0)
    joints = page.evaluate("() => globalThis.npend.chain.joints()")
    lengths = np.hypot(*np.diff(joints, axis=0).T)
    np.testing.assert_allclose(lengths, 0.2, atol=1e-12)


def test_the_picture_answers_to_keys(page):
    page.focus("#chain")
    page.keyboard.press("Space")
    assert page.text_content("#play") == "Play"
    paused = clock(page)
    page.keyboard.press(".")
    wait_for(page, lambda: paused < clock(page) < paused + 0.03)
    page.keyboard.press("ArrowUp")
    assert page.get_attribute("#chain", "aria-label") == "5 pendulums; bob 5 is chosen"
    before = pixel_of_bob(page, 5)
    page.keyboard.press("ArrowRight")
    assert pixel_of_bob(page, 5)[0] > before[0] - 0.5
    page.keyboard.press("r")
    wait_for(page, lambda: clock(page) == 0.0)
    page.keyboard.press("Space")
    wait_for(page, lambda: clock(page) > 0.1)
    page.keyboard.down("ArrowLeft")
    wait_for(page, lambda: "Bob 5 of 5 is pulled." in page.text_content("#status"))
    page.keyboard.up("ArrowLeft")
    wait_for(page, lambda: "pulled" not in page.text_content("#status"))


def test_keys_turn_the_chain_at_the_pivot(page):
    page.focus("#chain")
    for _ in range(6):
        page.keyboard.press("ArrowUp")
    assert page.get_attribute("#chain", "aria-label") == "5 pendulums; the pivot is chosen"
    page.keyboard.down("ArrowLeft")
    wait_for(page, lambda: "A motor turns 5 pendulums" in page.text_content("#status"))
    torque = page.evaluate(
        "globalThis.npend.chain.torque[0] / globalThis.npend.chain.liftingEnergy"
    )
    assert torque == -0.25
    page.keyboard.up("ArrowLeft")
    wait_for(page, lambda: "A motor" not in page.text_content("#status"))
    page.keyboard.press("Space")
    angles = "[...globalThis.npend.chain.theta]"
    before = np.array(page.evaluate(angles))
    page.keyboard.press("ArrowRight")
    np.testing.assert_allclose(page.evaluate(angles), before + 0.05, rtol=1e-12)


def test_keys_push_a_cart_and_the_picture_follows_it(open_page, tmp_path):
    page, chain = page_of(open_page, tmp_path, ON_CART)
    page.focus("#chain")
    for _ in range(4):
        page.keyboard.press("ArrowUp")
    assert page.get_attribute("#chain", "aria-label") == "3 pendulums; the cart is chosen"
    page.keyboard.down("ArrowRight")
    wait_for(page, lambda: page.text_content("#status") == "A motor pushes the cart.")
    weight = (chain.masses.sum() + chain.base.mass) * chain.gravity
    force = page.evaluate("globalThis.npend.chain.base.torque[3]")
    assert force == pytest.approx(0.5 * weight, rel=1e-12)
    wait_for(page, lambda: page.evaluate("globalThis.npend.chain.joints()[0][0]") > 2.0)
    page.keyboard.up("ArrowRight")
    page.keyboard.press("Space")
    assert page.get_attribute("#chain", "aria-label") == "3 pendulums; the cart is chosen"
    place = page.evaluate("globalThis.npend.chain.place")
    page.keyboard.press("ArrowRight")
    moved = place + 0.03 * chain.total_length
    assert page.evaluate("globalThis.npend.chain.place") == pytest.approx(moved)
    page.click("#release")
    assert page.evaluate("globalThis.npend.chain.place") == 0.0


def test_the_mouse_pulls_a_cart_and_its_energies_add_up(open_page, tmp_path):
    page, _ = page_of(open_page, tmp_path, ON_CART)
    start = pixel_of_bob(page, 0)
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(start[0] + 60.0, start[1])
    wait_for(page, lambda: page.text_content("#status") == "The cart is pulled.")
    wait_for(page, lambda: page.evaluate("globalThis.npend.chain.place") > 0.2)
    page.mouse.up()
    page.click("#play")
    state = "(({ theta, omega, place, speed, kinetic }) => ({ theta: [...theta], omega: [...omega],"
    found = page.evaluate(state + " place, speed, kinetic }))(globalThis.npend.chain)")
    angles, rates, speed = (np.array(found[name]) for name in ("theta", "omega", "speed"))
    kinetic = kinetic_of_motion(ON_CART, angles, rates, speed, None, None)
    assert found["kinetic"] == pytest.approx(float(kinetic), rel=1e-12)


def test_a_release_is_compared_with_the_models_until_it_is_disturbed(page):
    chain = Chain.uniform(5, gravity=page.evaluate("globalThis.npend.chain.gravity"))
    names = "all => all.map((one) => one.textContent)"
    legend = page.eval_on_selector_all(".legend span", names)
    periods = theory.models(chain, np.pi / 4)
    for name, period in zip(("T0", "T0+a", "T1", "T(N,a)"), periods, strict=True):
        assert f"{name}: {period:.4f} s" in legend
    slide(page, "damping", 0.5)
    wait_for(page, lambda: page.eval_on_selector_all(".legend span", names) == ["bobs"])


def test_angles_may_be_written_in_many_ways(open_page, path):
    page = opened(open_page, path)
    read = """(text) => {
      const field = document.getElementById("angles");
      field.value = text;
      field.dispatchEvent(new Event("change"));
      return [...globalThis.npend.chain.theta].map((angle) => (angle * 180) / Math.PI);
    }"""
    page.focus("#chain")
    page.keyboard.press("ArrowUp")  # a bob is chosen that a shorter chain lacks
    for text, angles in {
        "120, -10": [120, -10], "120\u00b0, \u221210\u00b0": [120, -10], "22,5; 10": [22.5, 10],
        "1e1 20": [10, 20], "30": [30, 30],
    }.items():  # fmt: skip
        assert page.evaluate(read, text) == pytest.approx(angles)
    assert page.text_content("#n-value") == "2 pendulums"
    before = clock(page)
    wait_for(page, lambda: clock(page) > before + 0.1)


def test_a_network_stands_the_rods_up_until_the_chain_is_released(page):
    page.select_option("#speed", "4")
    page.check("input[name=motor][value='2']", force=True)
    wait_for(page, lambda: "2 rods stand upright" in page.text_content("#status"))
    assert not page.is_visible("#measured")
    assert page.text_content("#n-value") == "2 pendulums"
    page.click("#release")
    assert page.is_checked("input[name=motor][value='0']")
    wait_for(page, lambda: page.is_visible("#measured"))  # with the next picture


def test_the_sliders_change_the_chain(page):
    slide(page, "n", 100)
    slide(page, "gravity", 1.62)
    slide(page, "lengths", 1)
    chain = page.evaluate(
        "() => { const { chain } = globalThis.npend;"
        " return [chain.n, [...chain.lengths], chain.totalLength, chain.output('ENERGY_ERROR')] }"
    )
    assert chain[0] == 100
    assert chain[1][-1] / chain[1][0] == pytest.approx(2.0)
    assert chain[2] == pytest.approx(100.0)
    assert page.get_attribute("#gravity", "aria-valuetext") == "1.62 m/s\u00b2"


@pytest.mark.parametrize("n", [5, 100])
def test_the_page_has_time_to_spare_at_60_pictures_a_second(page, n):
    slide(page, "n", n)
    spent = page.evaluate(
        """() => new Promise((resolve) => {
          const spent = [], real = globalThis.requestAnimationFrame;
          globalThis.requestAnimationFrame = (callback) => real((now) => {
            const start = performance.now();
            callback(now);
            spent.push(performance.now() - start);
            if (spent.length === 150) resolve(spent);
          });
        })"""
    )
    assert np.median(spent) < 1000.0 / 60.0 / 2.0


def test_with_reduced_motion_nothing_moves_until_asked(open_page, path):
    page = opened(open_page, path, reduced_motion="reduce")
    page.wait_for_timeout(300)
    assert (clock(page), page.text_content("#play")) == (0.0, "Play")
    page.click("#play")
    wait_for(page, lambda: clock(page) > 0.1)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("motor", [False, True])
def test_axe_finds_nothing_serious(open_page, path, scheme, motor):
    page = opened(open_page, path, color_scheme=scheme)
    page.evaluate("document.querySelector('details').open = true")
    if motor:
        page.check("input[name=motor][value='3']", force=True)
    assert grave_findings(page) == []


@pytest.mark.parametrize("width", [390, 320])
def test_the_page_fits_a_phone(open_page, path, width):
    page = opened(open_page, path, viewport={"width": width, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.locator("#chain").bounding_box()["height"] > 250


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
@pytest.mark.parametrize("panel", ["lesson", "measured"])
def test_the_picture_stays_in_view_where_a_panel_is_open(open_page, path, width, height, panel):
    page = opened(open_page, path, viewport={"width": width, "height": height})
    page.click(f"#{panel} summary")
    page.evaluate(f"document.getElementById('{panel}').scrollIntoView({{ block: 'end' }})")
    picture = page.locator("#chain").bounding_box()
    buttons = page.locator("#play").bounding_box()
    assert picture["y"] >= 0.0
    assert picture["height"] > 250
    assert buttons["y"] + buttons["height"] < height
    shown = page.locator(f"#{panel}").bounding_box()
    apart = picture["x"] + picture["width"] < shown["x"]
    assert apart or buttons["y"] + buttons["height"] < height / 2  # half of a phone is the panel's


def test_each_model_that_is_drawn_is_explained_in_a_sentence(page):
    page.click("#measured summary")
    terms = page.locator(".models dt").all_inner_texts()
    drawn = page.locator("#periods ~ figcaption .legend span").all_inner_texts()
    assert terms == [text.partition(":")[0] for text in drawn if text != "bobs"]
    for sentence in page.locator(".models dd").all_inner_texts():
        assert len(sentence) > 40
        assert sentence.endswith(".")
