import io
import os
import pickle
import zipfile

import pytest
import tiny
import torch

from manoeuvre_nn import __version__
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.training.checkpoint import VERSION_KEY, load_weights, read_checkpoint


@pytest.fixture(scope="module")
def stored(tmp_path_factory) -> bytes:
    out = tmp_path_factory.mktemp("run")
    tiny.train(tiny.lm(), out, max_epochs=1)
    return (out / "checkpoints" / "last.ckpt").read_bytes()


def refusal_of(path) -> str:
    with pytest.raises(InputError) as refusal:
        read_checkpoint(path)
    assert "\n" not in str(refusal.value) and str(path) in str(refusal.value)
    return str(refusal.value)


def changed(stored: bytes, path, **entries) -> None:
    content = torch.load(io.BytesIO(stored), weights_only=True)
    torch.save({k: v for k, v in {**content, **entries}.items() if v is not None}, path)


def test_a_checkpoint_holds_the_weights_and_who_wrote_it(stored, tmp_path):
    (tmp_path / "a.ckpt").write_bytes(stored)
    content = read_checkpoint(tmp_path / "a.ckpt")
    assert content[VERSION_KEY] == __version__
    other = tiny.lm()
    for parameter in other.dynamics.network.parameters():
        torch.nn.init.zeros_(parameter)
    load_weights(other, tmp_path / "a.ckpt")
    for name, value in other.state_dict().items():
        assert torch.equal(value, content["state_dict"][name])


def test_a_missing_file_is_refused(tmp_path):
    assert "does not exist: write the path of a .ckpt file" in refusal_of(tmp_path / "none.ckpt")


@pytest.mark.parametrize("kept", [0, 1, 10, 100, 0.3, 0.7, 0.99])
def test_a_truncated_file_is_refused(stored, tmp_path, kept):
    size = int(kept * len(stored)) if isinstance(kept, float) else kept
    (tmp_path / "cut.ckpt").write_bytes(stored[:size])
    refusal_of(tmp_path / "cut.ckpt")


def test_foreign_files_are_refused(tmp_path):
    path = tmp_path / "foreign.ckpt"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("hello.txt", "hello")
    refusal_of(path)
    for text in ("hello\n", "epoch,loss\n1,2\n", "a", "(((((", "\x80", "I1\n.", "{}", "\n\n"):
        path.write_text(text)
        refusal_of(path)
    generator = torch.Generator().manual_seed(0)
    for size in [*range(1, 40), 400, 4000]:
        path.write_bytes(bytes(torch.randint(256, (size,), generator=generator).tolist()))
        refusal_of(path)
    path.write_bytes(pickle.dumps({"state_dict": {}, VERSION_KEY: __version__}))
    refusal_of(path)


def test_files_of_torch_that_are_no_checkpoints_of_ours_are_refused(stored, tmp_path):
    path = tmp_path / "other.ckpt"
    for content in (torch.zeros(3), [1, 2], {"state_dict": {}}, {VERSION_KEY: __version__}):
        torch.save(content, path)
        assert "is not a checkpoint of manoeuvre-nn" in refusal_of(path)


class Hostile:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("way", ["torch", "pickle", "old torch"])
def test_code_in_a_checkpoint_is_refused_and_not_run(way, tmp_path):
    trace, path = tmp_path / "was_here", tmp_path / "hostile.ckpt"
    content = {"state_dict": {"w": Hostile(trace)}, VERSION_KEY: __version__, "epoch": 1}
    if way == "pickle":
        path.write_bytes(pickle.dumps(content))
    else:
        torch.save(content, path, _use_new_zipfile_serialization=way == "torch")
    assert "is refused" in refusal_of(path)
    assert not trace.exists()
    torch_would = tmp_path / "control"
    pickle.loads(pickle.dumps(Hostile(torch_would)))
    assert torch_would.exists(), "the trap itself works"


@pytest.mark.parametrize("version", ["9.9.0", "9.9", "", None])
def test_another_version_is_refused(stored, tmp_path, version):
    changed(stored, tmp_path / "v.ckpt", **{VERSION_KEY: version})
    message = refusal_of(tmp_path / "v.ckpt")
    assert (f"this is {__version__}" in message) == (version is not None)


def test_another_patch_of_the_same_version_is_read(stored, tmp_path):
    major, minor, *_ = __version__.split(".")
    changed(stored, tmp_path / "v.ckpt", **{VERSION_KEY: f"{major}.{minor}.99"})
    assert "state_dict" in read_checkpoint(tmp_path / "v.ckpt")


def test_weights_of_another_size_are_refused_and_leave_the_network_alone(stored, tmp_path):
    (tmp_path / "a.ckpt").write_bytes(stored)
    other = tiny.lm(hidden=4)
    before = tiny.weights(other)
    with pytest.raises(InputError, match="is of another network: size mismatch for dynamics.network") as refusal:
        load_weights(other, tmp_path / "a.ckpt")
    assert "\n" not in str(refusal.value)
    assert all((a == b).all() for a, b in zip(before, tiny.weights(other), strict=True))


def test_a_bit_that_has_turned_over_is_seen(tmp_path):
    path = tmp_path / "model.ckpt"
    torch.save({"weights": torch.arange(1000.0)}, path)
    whole = bytearray(path.read_bytes())
    whole[whole.index(torch.arange(1000.0).numpy().tobytes()) + 2001] ^= 1
    path.write_bytes(whole)
    assert not torch.equal(torch.load(path, weights_only=True)["weights"], torch.arange(1000.0))
    with pytest.raises(InputError, match="is damaged: .* is not what was written"):
        read_checkpoint(path)
