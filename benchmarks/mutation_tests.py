"""Which test executes which line, and a few tests run against one slip: the two halves of :mod:`mutation`.

The libraries are imported once; every run of tests is a fork that imports the package anew.
"""

import functools
import hashlib
import importlib
import importlib.abc
import importlib.machinery
import json
import os
import re
import resource
import signal
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FrameType

import pytest
from mutation_source import ROOT, Mutant

LIBRARIES = (
    "torch numpy scipy.optimize scipy.signal scipy.stats scipy.linalg scipy.interpolate scipy.integrate pandas sympy "
    "lightning hydra matplotlib.pyplot statsmodels.api torchdiffeq pydantic yaml rich.table jinja2 jaxtyping "
    "threadpoolctl torch.utils.tensorboard"
).split()
ARGUMENTS = ["-o", "addopts=", "-m", "not slow", "-q", "-x", "-p", "no:cacheprovider", "-n", "0"]
TRACING = 2.5
"""How many times longer a test may take while its lines are recorded."""
SHARED_LIMIT = 30.0
"""Seconds that a fixture or a cached function may take."""


def load_libraries() -> None:
    """Import what every test needs, but nothing of the package."""
    for name in LIBRARIES:
        importlib.import_module(name)
    importlib.import_module("torch").set_num_threads(1)
    importlib.import_module("threadpoolctl").threadpool_limits(1)


def forked(work: Callable[[], int], limit: float) -> int | None:
    """Some work in a process of its own that says nothing.

    Time is that of the processor: the machine may be busy. What waits without end is ended after ten times as long.

    Args:
        work: What is done.
        limit: Most time [s].

    Returns:
        The exit code; None if it ran longer.
    """
    if not (child := os.fork()):
        code = 70
        try:
            os.setsid()
            resource.setrlimit(resource.RLIMIT_CPU, (int(limit) + 1, int(limit) + 10))
            silent = os.open(os.environ.get("MUTATION_LOG", os.devnull), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(silent, 1)
            os.dup2(silent, 2)
            code = work()
        finally:
            os._exit(code)
    until, wait = time.monotonic() + 10 * limit, 0.005
    while time.monotonic() < until:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            code = os.waitstatus_to_exitcode(status)
            return None if code == -signal.SIGXCPU else code
        time.sleep(wait := min(2 * wait, 0.1))
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


class Recorder:
    """Pytest plugin: lines that every test executes, itself or through fixtures and cached functions that it shares."""

    def __init__(self, slowest: float, left_out: frozenset[str]) -> None:
        """Begin to record."""
        import coverage

        folders = [str(ROOT / folder) for folder in ("src", "studies", "tests")]
        self.coverage = coverage.Coverage(data_file=None, config_file=False, source=folders, messages=False)
        self.slowest, self.left_out = slowest, left_out
        self.stack: list[str] = ["import"]
        self.uses: dict[str, set[str]] = defaultdict(set)
        self.seconds: dict[str, float] = defaultdict(float)
        self.failed: set[str] = set()
        signal.signal(signal.SIGPROF, _too_slow)
        functools.cache = self.cached  # type: ignore[assignment]
        functools.lru_cache = self.lru_cached  # type: ignore[assignment]
        self.coverage.start()
        self.coverage.switch_context("import")

    @contextmanager
    def inside(self, name: str, limit: float) -> Generator[None, None, None]:
        """What is executed belongs to this name until the end, and the time; at most so long [s]."""
        left = signal.setitimer(signal.ITIMER_PROF, limit)[0]
        self._clock()
        self.uses[self.stack[-1]].add(name)
        self.stack.append(name)
        self.coverage.switch_context(name)
        try:
            yield
        finally:
            self._clock()
            self.stack.pop()
            self.coverage.switch_context(self.stack[-1])
            signal.setitimer(signal.ITIMER_PROF, left)

    def _clock(self) -> None:
        """Give the time since the last change to who has spent it."""
        now = time.process_time()
        self.seconds[self.stack[-1]] += now - getattr(self, "since", now)
        self.since = now

    def cached(self, function: Callable) -> Callable:
        """Like :func:`functools.cache`; who calls later has executed the lines as well."""
        if not getattr(function, "__code__", None) or not function.__code__.co_filename.startswith(str(ROOT)):
            return _LRU_CACHE(maxsize=None)(function)
        results: dict = {}

        @functools.wraps(function)
        def call(*args: object, **named: object) -> object:
            key = (args, tuple(sorted(named.items())))
            if key not in results:
                name = f"cached {function.__module__}.{function.__qualname__} {len(results)}"
                with self.inside(name, SHARED_LIMIT):
                    results[key] = (name, function(*args, **named))
            self.uses[self.stack[-1]].add(results[key][0])
            return results[key][1]

        call.cache_clear = results.clear  # type: ignore[attr-defined]
        return call

    def lru_cached(self, maxsize: object = 128, typed: bool = False) -> Callable:
        """Like :func:`functools.lru_cache`."""
        if callable(maxsize):
            return self.cached(maxsize)
        return self.cached

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Tests that are known to be slow are not begun."""
        items[:] = [item for item in items if item.nodeid not in self.left_out]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """A test with a limit of time."""
        with self.inside(item.nodeid, TRACING * self.slowest):
            return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef, request: pytest.FixtureRequest) -> Iterator[None]:
        """Lines of a fixture of several tests are those of every one of them."""
        if fixturedef.scope == "function":
            return (yield)
        with self.inside(_name(fixturedef, fixturedef.cache_key(request)), SHARED_LIMIT):
            return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        """The fixtures that a test has used."""
        try:
            return (yield)
        finally:
            for fixture in item._request._fixture_defs.values():  # type: ignore[attr-defined]
                if fixture.scope != "function" and fixture.cached_result is not None:
                    self.uses[item.nodeid].add(_name(fixture, fixture.cached_result[1]))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Only tests that pass can tell a slip."""
        if not report.passed:
            self.failed.add(report.nodeid)

    def result(self) -> dict:
        """Tests that passed in time with what they share, and the lines of each name."""
        self.coverage.stop()
        data = self.coverage.get_data()
        lines: dict[str, dict[str, list[int]]] = defaultdict(lambda: defaultdict(list))
        for path in data.measured_files():
            for line, names in data.contexts_by_lineno(path).items():
                for name in names:
                    lines[name][str(Path(path).relative_to(ROOT))].append(line)
        tests = [n for n in self.uses["import"] if "::" in n and n not in self.failed]
        tests = [n for n in tests if self.seconds[n] < TRACING * self.slowest]
        return {
            "tests": sorted(tests),
            "uses": {n: sorted(used - {n}) for n, used in self.uses.items() if n != "import"},
            "seconds": {n: round(s, 3) for n, s in self.seconds.items()},
            "lines": lines,
        }


_LRU_CACHE = functools.lru_cache


def _too_slow(_: int, frame: FrameType | None) -> None:
    """End a test that takes too long; a moment later where coverage would keep what it has locked."""
    if frame is not None and frame.f_code.co_filename.endswith("coverage/collector.py"):
        signal.setitimer(signal.ITIMER_PROF, 0.05)
        return
    raise TimeoutError


def _name(fixture: pytest.FixtureDef, key: object) -> str:
    """Of a fixture with its parameter."""
    return f"fixture {fixture.baseid} {fixture.argname} {key!r:.80}"


@dataclass
class TestMap:
    """Which test executes which line.

    Attributes:
        seconds: Test, fixture or cached function -> time while lines were recorded [s].
        shared: Test -> fixtures and cached functions that it uses.
        by_line: File -> line -> tests.
        collected: Tests of a file, and the lines that are executed while they are collected, for their cases, say.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    shared: dict[str, frozenset[str]] = field(default_factory=dict)
    by_line: dict[str, dict[int, set[str]]] = field(default_factory=lambda: defaultdict(lambda: defaultdict(set)))
    collected: list[tuple[set[str], set[tuple[str, int]]]] = field(default_factory=list)

    def add(self, recorded: dict) -> None:
        """The tests of one file."""
        users = defaultdict(set)
        for test in recorded["tests"]:
            used, new = {test}, {test}
            while new:
                new = {n for name in new for n in recorded["uses"].get(name, ())} - used
                used |= new
            self.shared[test] = frozenset(used - {test})
            for name in used:
                users[name].add(test)
        self.seconds |= recorded["seconds"]
        for name, tests in users.items():
            for file, lines in recorded["lines"].get(name, {}).items():
                for line in lines:
                    self.by_line[file][line] |= tests
        imported = recorded["lines"].get("import", {})
        self.collected.append((set(recorded["tests"]), {(file, line) for file in imported for line in imported[file]}))

    def chosen(self, lines: Iterable[tuple[str, int]], most: float) -> tuple[list[str], float]:
        """Tests that execute any of the lines, cheapest first, as many as take so long; and their time [s].

        Those come last whose cases execute them.

        Args:
            lines: File and number.
            most: Time [s].

        Returns:
            The tests, and their time [s].
        """
        places = set(lines)
        direct = set().union(*(self.by_line.get(file, {}).get(line, set()) for file, line in places))
        found = direct.union(*(tests for tests, imported in self.collected if places & imported))
        whole = {t: self.seconds[t] + sum(self.seconds.get(s, 0.0) for s in self.shared[t]) for t in found}
        paid: set[str] = set()
        taken, total = [], 0.0
        for test in sorted(found, key=lambda t: (t not in direct, whole[t], t)):
            cost = self.seconds[test] + sum(self.seconds.get(s, 0.0) for s in self.shared[test] - paid)
            if total + cost <= most or not taken:
                taken.append(test)
                total += cost
                paid |= self.shared[test]
        return taken, total


def test_map(files: list[Path], cache: Path, slowest: float, left_out: frozenset[str]) -> TestMap:
    """The map of some files of tests; what was recorded before and has not changed is read."""
    rooms = [path for folder in ("src", "studies") for path in sorted((ROOT / folder).rglob("*.py"))]
    source = _digest([Path(__file__), *rooms])
    found = TestMap()
    cache.mkdir(parents=True, exist_ok=True)
    for file in files:
        stored = cache / f"{file.stem}-{source}-{_digest([file, *_helpers(file)])}-{slowest:g}.json"
        if not stored.exists():
            print(f"which lines do the tests of {file.relative_to(ROOT)} execute", flush=True)
            forked(functools.partial(_record, file, stored, slowest, left_out), limit=1800.0)
        if stored.exists():
            found.add(json.loads(stored.read_text()))
        else:
            print(f"warning: nothing was recorded of {file}")
    return found


def _helpers(file: Path) -> list[Path]:
    """Modules beside a file of tests, or above it, that it names, and those that these name; fixtures of all."""
    beside = sorted({*(ROOT / "tests").glob("*.py"), *file.parent.glob("*.py")})
    others = {path.stem: path for path in beside if not path.name.startswith("test_")}
    found: dict[str, Path] = {}
    new = {file.stem: file} | {stem: path for stem, path in others.items() if stem == "conftest"}
    while new:
        found |= new
        named = set(re.findall(r"\w+", " ".join(path.read_text() for path in new.values())))
        new = {stem: path for stem, path in others.items() if stem in named and stem not in found}
    return sorted(path for path in found.values() if path != file)


def _record(file: Path, stored: Path, slowest: float, left_out: frozenset[str]) -> int:
    """Run a file of tests and write down which lines each has executed."""
    recorder = Recorder(slowest, left_out)
    code = pytest.main([*(w for w in ARGUMENTS if w != "-x"), str(file)], plugins=[recorder])
    if code in {pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED, pytest.ExitCode.NO_TESTS_COLLECTED}:
        stored.with_suffix(".part").write_text(json.dumps(recorder.result()))
        stored.with_suffix(".part").rename(stored)
    return int(code)


def _digest(paths: list[Path]) -> str:
    """Of the contents of files."""
    return hashlib.sha1(b"".join(p.read_bytes() for p in paths)).hexdigest()[:10]


class _Loader(importlib.machinery.SourceFileLoader):
    """Serves a module with a slip in it."""

    def __init__(self, name: str, path: str, code: object) -> None:
        super().__init__(name, path)
        self.code = code

    def get_code(self, fullname: str) -> CodeType:
        """The code with the slip."""
        return self.code  # type: ignore[return-value]


class _Finder(importlib.abc.MetaPathFinder):
    """Finds the one module that has a slip."""

    def __init__(self, mutant: Mutant) -> None:
        self.name = mutant.file.removeprefix("src/").removesuffix(".py").replace("/", ".")
        self.path, self.code = str(ROOT / mutant.file), mutant.code()

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> object:
        """A specification with the other loader."""
        if fullname != self.name:
            return None
        return importlib.util.spec_from_file_location(
            fullname, self.path, loader=_Loader(fullname, self.path, self.code)
        )


class _Chosen:
    """Pytest plugin: only these tests, in this order; the first that fails is written down."""

    def __init__(self, tests: list[str], told: int) -> None:
        self.rank = {test: k for k, test in enumerate(tests)}
        self.told = told

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Cheapest first."""
        items[:] = sorted((i for i in items if i.nodeid in self.rank), key=lambda i: self.rank[i.nodeid])

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Who told the slip."""
        if report.failed:
            os.write(self.told, report.nodeid.encode())


def judged(mutant: Mutant | None, tests: list[str], seconds: float) -> tuple[str, str]:
    """What tests say of a slip (of none, if None): killed, late or survived; and which test told it."""
    reading, writing = os.pipe()

    def work() -> int:
        if mutant is not None:
            sys.meta_path.insert(0, _Finder(mutant))
        files = list(dict.fromkeys(test.split("::")[0] for test in tests))
        return int(pytest.main([*ARGUMENTS, *files], plugins=[_Chosen(tests, writing)]))

    code = forked(work, 4 * seconds + 20.0)
    os.close(writing)
    with os.fdopen(reading) as pipe:
        told = pipe.read()
    if code is None:
        return "late", ""
    return ("survived" if code == 0 else "killed"), told or f"exit code {code}"
