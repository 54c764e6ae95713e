"""``manoeuvre train task=pitch``: approximate a response of a ship in a seaway by a network."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import fields, replace
from math import inf, isfinite
from pathlib import Path
from typing import Any

import torch
from omegaconf import DictConfig
from rich.console import Console

from manoeuvre_nn.commands import config as configs
from manoeuvre_nn.commands.job import Job, blank_network, check_pair, config_beside, fit_of, made_again, session_of
from manoeuvre_nn.commands.settings import SWITCH
from manoeuvre_nn.commands.shelves import build, check_arguments, made_by, plain
from manoeuvre_nn.core.data_files import check_plain, load_yaml, without_format
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.response import Quantities, Response, Variable
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.waiting import waiting
from manoeuvre_nn.recording.read.records import RecordsMapping, records_mapping, unit_size
from manoeuvre_nn.report.response_figures import response_figures
from manoeuvre_nn.seakeeping.form import HullForm, estimated_form
from manoeuvre_nn.training import session
from manoeuvre_nn.training.checkpoint import load_weights, read_checkpoint
from manoeuvre_nn.training.fits import Fit
from manoeuvre_nn.training.response_data import ResponseData, Split, recorded_records
from manoeuvre_nn.training.response_score import ResponseScore
from manoeuvre_nn.training.scalings import OF_RESPONSES, response_scaling

VARIABLE = {"unit", "meaning", "symbol", "values", "possible"}
"""What a task says of a variable."""
PARTS = ("inputs", "output", "sees", "network", "fit")
"""What a config must say for its approximation to be made again."""
OF_RECORDS = ("_target_", "folder", "files", "mapping")
"""Settings of ``data=recording`` that tables of records have."""


def prepare(cfg: DictConfig) -> Job[ResponseData]:
    """Build and check everything that needs no computing.

    Args:
        cfg: The config.

    Returns:
        The job.
    """
    quantities, values = quantities_of(cfg)
    network, scaling, dtype = response_network(cfg, quantities)
    check_pair(cfg, type(network))
    check_arguments(ResponseScore, cfg.scoring, "scoring", ["data"])
    data = _data(cfg, quantities, values, dtype)
    _blank_fit(cfg, quantities, deepcopy(network), dtype)  # so that its settings are refused before any computing
    return Job(data, network, scaling, dtype, session_of(cfg))


def quantities_of(cfg: DictConfig) -> tuple[Quantities, dict[str, list[float]]]:
    """Variables and response of a task.

    Args:
        cfg: The config, with ``inputs``, ``output`` and ``per``.

    Returns:
        Variables and response, and variable -> values of its grid [SI].

    Raises:
        InputError: If a variable is not said as it should be.
    """
    inputs, values = [], {}
    for name, said in plain(cfg.inputs).items():
        variable = _variable(f"inputs.{name}", name, said)
        inputs.append(variable)
        grid = said.get("values") or []
        if not isinstance(grid, list) or any(isinstance(v, bool) or not isinstance(v, int | float) for v in grid):
            raise InputError(f"inputs.{name}.values={grid}: expected numbers in brackets such as [5,10,15]")
        values[name] = sorted(float(v) * variable.size for v in grid)
    output = plain(cfg.output)
    response = _variable("output", str(output.get("name")), {k: v for k, v in output.items() if k != "name"})
    per, sees = cfg.get("per"), plain(cfg.sees)
    for name, wanted in sees.items():
        SWITCH.check(f"sees.{name}", wanted)
    seen = [name for name, wanted in sees.items() if wanted]
    return Quantities(inputs, response, seen, None if per in {None, "none"} else str(per)), values


def _variable(where: str, name: str, said: Any) -> Variable:
    """A variable of a task."""
    if not isinstance(said, Mapping):
        raise InputError(f"{where}={said}: expected unit, meaning and values")
    for key in said:
        check_choice(where, key, sorted(VARIABLE))
    size = unit_size(str(said.get("unit", "-")))
    possible = said.get("possible") or [-inf, inf]
    if not isinstance(possible, list) or [type(end) in {int, float} for end in possible] != [True, True]:
        raise InputError(f"{where}.possible={possible}: expected the smallest and the largest value, such as [0, 5]")
    low, high = possible
    about = {key: str(said[key]) for key in ("meaning", "symbol") if said.get(key) is not None}
    ends = {"low": float(low) * size, "high": float(high) * size}
    try:
        return Variable(name, str(said.get("unit", "-")), size, **{"meaning": "", **about}, **ends)  # type: ignore[arg-type]
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def response_network(cfg: DictConfig, quantities: Quantities) -> tuple[Network, str, torch.dtype]:
    """The network with its first weights, with an input for each variable that it sees.

    Args:
        cfg: The config.
        quantities: Variables and response.

    Returns:
        Network, kind of scaling, floating type. A network that is made for the forces of a ship is refused.
    """
    return blank_network(cfg, OF_RESPONSES, {"inputs": len(quantities.sees), "outputs": 1})


def _data(
    cfg: DictConfig, quantities: Quantities, values: Mapping[str, list[float]], dtype: torch.dtype
) -> ResponseData:
    """The data module: records to be computed, or read from tables."""
    settings = plain(cfg.data)
    shares = {"learning": cfg.learning, "validation": settings.pop("validation", 0.0)}
    check_arguments(Split, shares, "data")
    ship = build(cfg.ship, "ship").particulars
    common: dict[str, Any] = {"split": Split(**shares, seed=cfg.seed), "dtype": dtype}
    if "files" in settings:
        extra = [f"data.{k}={v}" for k, v in settings.items() if k not in OF_RECORDS and v not in (None, [], "auto")]
        if extra:
            raise InputError(f"{extra[0]} is for recordings over time; tables of records have no such setting")
        columns = read_records_mapping(settings["mapping"])
        files = configs.names(settings["files"])
        folder = str(settings["folder"])
        return recorded_records(quantities, files, columns, hull_form(cfg, ship), folder=folder, **common)
    if made_by(settings, "data") is not ResponseData:
        raise InputError(f"task={cfg.task} learns records: write data=seakeeping or data=recording")
    return build(
        settings, "data", quantities=quantities, values=values, form=hull_form(cfg, ship), ship=ship.name, **common
    )


def hull_form(cfg: DictConfig, ship: Particulars) -> HullForm:
    """The hull that waves meet: estimated from the ship's particulars, but for what ``form=`` says."""
    said = {name: value for name, value in plain(cfg.form).items() if value is not None}
    known = {f.name for f in fields(HullForm)}
    for name, value in said.items():
        check_choice("form", name, sorted(known))
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            raise InputError(f"form.{name}={value}: expected a number")
    return replace(estimated_form(ship), **{name: float(value) for name, value in said.items()})


def read_records_mapping(path: str | None) -> RecordsMapping | None:
    """Read a mapping of tables of records.

    Args:
        path: A yaml; None for headings as this package writes them.

    Returns:
        The mapping, or None.

    Raises:
        InputError: If it is no such mapping.
    """
    if path is None:
        return None
    content = load_yaml(Path(path))
    if not isinstance(content, Mapping) or "columns" not in content:
        raise InputError(f"data.mapping={path} is no mapping of records: write columns: into it")
    settings = {str(k): v for k, v in without_format(content, f"data.mapping={path}").items()}
    check_plain(settings, f"data.mapping={path}")
    return records_mapping(**settings)


def _blank_fit(cfg: DictConfig, quantities: Quantities, network: Network, dtype: torch.dtype) -> Fit:
    """The chosen method with an approximation that has seen no records."""
    count = len(quantities.sees)
    blank = Scaling(torch.zeros(count), torch.ones(count), torch.ones(1), torch.zeros(1))
    return fit_of(cfg, Response(network, blank, quantities).to(dtype))


def make_response_fit(cfg: DictConfig, job: Job[ResponseData]) -> Fit:
    """Join network and scaling of a job whose data are set up, and give them to the chosen method."""
    x, y, *_ = job.data.train_dataloader().dataset[0]
    scaling = response_scaling(job.scaling, x, y)
    made = fit_of(cfg, Response(job.network, scaling, job.data.quantities).to(job.dtype))
    made.errors_of = (job.data.quantities.output.name,)
    return made


def fit(cfg: DictConfig, job: Job[ResponseData], out: Path, console: Console) -> session.Trained:
    """Compute or take the records, and train on them; checkpoints are kept in the output folder."""
    with waiting(console) as job.data.say:
        job.data.say("records")
        job.data.setup()
    score = ResponseScore(job.data, draw=response_figures, **cfg.scoring)
    return session.run(make_response_fit(cfg, job), job.data, score, job.session, out, console)


def load_response(path: Path) -> Response:
    """An approximation of a response from the checkpoint of a training.

    Args:
        path: ``OUT/checkpoints/best.ckpt`` or ``last.ckpt``; the run's ``OUT/config.yaml`` says what the network is.

    Returns:
        The approximation in double precision; a checkpoint or config that cannot be used is refused.
    """
    read_checkpoint(path)
    cfg = config_beside(path, PARTS)
    with made_again(path):
        quantities, _ = quantities_of(cfg)
        network, _, dtype = response_network(cfg, quantities)
        made = _blank_fit(cfg, quantities, network, dtype)
    load_weights(made, path)
    assert isinstance(made.dynamics, Response)
    return made.dynamics.double()
