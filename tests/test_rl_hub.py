import os
import threading
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from hashlib import sha256
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import gymnasium as gym
import numpy as np
import pytest
from scripts import run_python

from npend_gym.rl import Policy, evaluate, write_repository
from npend_gym.rl.policies.model_card import task_of

hub = pytest.importorskip("huggingface_hub")
COMMIT = "0123456789" * 4


@pytest.fixture
def policy():
    return Policy.pretrained("swingup-1")


@pytest.mark.parametrize(
    ("env", "task"),
    [
        ({"n": 2, "mode": "swingup", "observation": "sincos"}, "npend/SwingUp-v1"),
        ({}, "npend/SwingUp-v1"),
        ({"mode": "balance"}, "npend/Balance-v1"),
        ({"mode": "balance", "base": "cart", "n": 1}, "npend/CartPole-v1"),
        (Policy.pretrained("balance-2-cart").env, "npend/CartDoublePole-v1"),
        (Policy.pretrained("balance-5-cart").env, "npend/CartTriplePole-v1"),
        ({"mode": "passive"}, "npend/Release-v1"),
        ({"mode": "npend_gym.envs.modes:SwingUp"}, "NPendulum-v0"),
    ],
)
def test_the_task_of_a_policy_is_the_named_one_with_its_mode_and_base(env, task):
    assert task_of(env) == task


def test_the_task_of_a_model_that_was_trained_on_a_cart_has_the_cart():
    algorithms = pytest.importorskip("stable_baselines3")
    model = algorithms.PPO("MlpPolicy", gym.make("npend/CartPole-v1"), device="cpu")
    assert task_of(Policy.from_sb3(model).env) == "npend/CartPole-v1"


@pytest.mark.parametrize(
    ("folder", "name", "error"), [("new", 3, TypeError), ("file", "me/x", FileExistsError)]
)
def test_what_cannot_be_written_is_refused_before_any_episode(
    folder, name, error, policy, tmp_path, monkeypatch
):
    (tmp_path / "file").write_text("mine")
    monkeypatch.setattr("npend_gym.rl.policies.model_card.evaluate", pytest.fail)
    with pytest.raises(error, match=r"name must be a text, got 3|File exists"):
        write_repository(policy, tmp_path / folder, name)


@pytest.mark.long
def test_the_card_tells_the_hub_what_evaluate_finds(policy, tmp_path):
    found = write_repository(policy, tmp_path / "new", "one-rod", episodes=10)
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == [
        "README.md", "policy.safetensors"
    ]  # fmt: skip
    card = hub.ModelCard.load(tmp_path / "new" / "README.md")  # as the Hub reads it
    result, success = card.data.eval_results
    assert (result.dataset_type, card.data.model_name) == ("npend/SwingUp-v1", "one-rod")
    again = evaluate(policy, policy.env, episodes=10)
    np.testing.assert_array_equal(found.returns, again.returns)
    mean, _, deviation = result.metric_value.split()
    assert float(mean) == pytest.approx(again.returns.mean(), abs=0.01)
    assert float(deviation) == pytest.approx(again.returns.std(), abs=0.01)
    assert success.metric_value == again.success_rate


@pytest.mark.parametrize(
    ("name", "repository"), [("me/one-rod", "me/one-rod"), ("one-rod", "USER/one-rod")]
)
def test_the_example_of_a_card_names_the_repository_once(name, repository, policy, tmp_path):
    write_repository(policy, tmp_path, name, episodes=2)
    card = hub.ModelCard.load(tmp_path / "README.md")
    assert f'Policy.from_hub("{repository}")' in card.content
    assert card.data.model_name == "one-rod"
    assert "\n# one-rod\n" in card.content


def test_the_card_says_what_is_true_of_the_seeds_and_of_a_mode_of_ones_own(tmp_path):
    shipped = Policy.pretrained("swingup-1")
    own = replace(shipped, env=shipped.env | {"mode": "npend_gym.envs.modes:SwingUp"})
    texts: list[str] = []
    for given, seed in ((shipped, 1_000_000), (shipped, 0), (own, 0)):
        write_repository(given, tmp_path, "me/x", episodes=2, seed=seed)
        texts.append((tmp_path / "README.md").read_text())
    assert ["which no training takes" in text for text in texts] == [True, False, False]
    assert ['from_hub("me/x", trust=True)' in text for text in texts] == [False, False, True]


class Repositories(BaseHTTPRequestHandler):
    """Files in a folder under the addresses that the Hub has for them."""

    def __init__(self, folder, *arguments):
        self.folder = folder
        super().__init__(*arguments)

    def do_GET(self):
        user, name, _, _, file = self.path.partition("?")[0].strip("/").split("/", 4)
        path = self.folder / user / name / file
        found = path.is_file()
        content = path.read_bytes() if found else b""
        self.send_response(200 if found else 404)
        self.send_header("X-Repo-Commit", COMMIT)
        if not found:
            self.send_header("X-Error-Code", "EntryNotFound")
        self.send_header("ETag", f'"{sha256(content).hexdigest()}"')
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(content)

    do_HEAD = do_GET  # noqa: N815

    def log_message(self, *_):
        pass


@contextmanager
def stand_in(folder):
    """A server of this machine in place of the Hub: its address."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Repositories, folder))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


OTHERS = """
try:
    Policy.from_hub("USER/one-rod", "another.safetensors")
except OSError as error:
    print(type(error).__name__)
try:
    Policy.from_hub("USER/one-rod", "README.md")
except ValueError as error:
    print(error)
print(Policy.from_hub("USER/one-rod", "deep/one.safetensors").env["mode"])
"""


@pytest.mark.long
def test_the_example_of_a_card_loads_the_policy_from_a_hub(policy, tmp_path):
    repository = tmp_path / "USER" / "one-rod"
    write_repository(policy, repository, "one-rod", episodes=5)
    (repository / "deep").mkdir()
    policy.save(repository / "deep" / "one.safetensors")
    example = (repository / "README.md").read_text().split("```python\n")[1].split("```")[0]
    with stand_in(tmp_path) as address:
        own = {"HF_ENDPOINT": address, "HF_HOME": str(tmp_path / "kept"), "NO_PROXY": "127.0.0.1"}
        told = run_python("-c", example + OTHERS, env=os.environ | own).splitlines()
    assert told[0] == "1.0"
    assert "NotFound" in told[1]
    assert "path must end in .safetensors" in told[2]
    assert told[3:] == ["swingup"]
