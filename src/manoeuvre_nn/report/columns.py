"""What every column of a page's tables says, in a line that stands where the table is."""

import re
from collections.abc import Mapping

JOBS, RUNS = "Jobs, best first", "Runs"
"""Headings of the tables of a sweep's jobs and of runs that are compared."""
RUNS_BY_MANOEUVRE, RUNS_BY_SETTING = "Runs by held-out manoeuvre", "Runs by the other settings in which they differ"
"""Tables of what has no room in that of the runs."""
EXPLAINED = {
    # scores of a model
    "manoeuvre": "the run by its name: zz20 a zigzag with 20 deg, tc35 a turning circle with 35 deg, or a file",
    "status": "ok: the run went on to its end, far off: more than .5 L from the recorded track; else why it was ended",
    "dev/L": "largest distance between predicted and recorded track over the ship's length L",
    "spread/L": "distance over L that nine of ten members of an ensemble keep from its prediction where it is largest: "
    "it grows where the training leaves open what the ship does",
    "criteria, predicted (recorded)": "the main criteria as the model has them, and in brackets as recorded",
    "criterion": "what is measured on the run, such as advance or overshoot",
    "unit": "unit of the values in this row",
    "predicted": "as the model has it",
    "recorded": "as the recording or the reference ship has it",
    "error": "predicted less recorded",
    "value": "the value found",
    "limit": "largest value that the resolution allows",
    "linear dev/L": "dev/L of Clarke's formulas for linear derivatives from the ship's particulars: nothing learnt",
    "taylor dev/L": "dev/L of a third-order Taylor series about the approach in place of the network, fitted to the"
    " same data by least squares",
    "true terms dev/L": "dev/L of the very products whose sum the forces of the reference ship are, their coefficients"
    " fitted to the same data by least squares",
    "verdict": "ok: as it should be; note: to know of; mend: a setting of the mapping mends it; refuse: the recording"
    " cannot be used",
    # responses
    "records": "which set of records: those learnt from, those kept to choose, those kept to test, or points between",
    "number": "how many there are",
    "correlation": "between the response of the records and that of the network; 1 at best",
    "variable": "name of an input of the network",
    "meaning": "what it is",
    "from": "lower end of the range that was learnt",
    "to": "upper end of the range that was learnt",
    "input": "name of an input of the network",
    "error ratio, mean": "error with this input held at its mean over the error with it: 1 if it is not used",
    "error ratio, permuted": "the same with the values of this input shuffled among the records",
    "Sobol first": "share of the response's variance that this input makes alone",
    "Sobol total": "the same together with all other inputs",
    # coefficients
    "symbol": "of the coefficient; the index says of which motions and rudder angles it is the factor",
    "± 95 %": "half of the 95 % interval by the recordings",
    "± 95 % ": "half of the 95 % interval by the captive tests",
    "before": "the value that was assumed before the recordings",
    "± before": "half of the 95 % interval that was assumed",
    "narrowed by [%]": "share of the assumed interval that the recordings took away",
    "it is": "measured: the recordings took away at least three quarters of the assumed interval; partly: at least a"
    " tenth; together: its error goes with that of others so closely that a sum alone is known; prior: as"
    " assumed before",
    "together": "coefficients whose errors go together: these recordings hardly tell them apart",
    "corr.": "correlation of their errors",
    "why": "what these recordings do not tell apart",
    "known is": "the sum that is known though its parts are not",
    "quantity": "what follows from the coefficients",
    "that is": "what the value means for the ship",
    "recordings": "value by the free runs",
    "captive": "value by the captive tests",
    "apart by": "distance of both values in standard deviations; empty where one is not known",
    "they": "whether both agree",
    # checks of recordings
    "recording": "name of the file",
    "check": "what was looked at",
    "measured": "what was found",
    "expected": "what a sound recording has",
    "what, and what to do": "the finding in words and the setting that mends it",
    "refuse": "number of findings that forbid to use the file",
    "mend": "number of findings that a setting of the mapping mends",
    "note": "number of findings to know of",
    "ok": "number of checks that found nothing",
    "to be done": "checks after which something is to be done",
    "fault": "a sensor's fault: the same in every recording if it is real",
    "found in": "in how many recordings it is large enough to matter",
    "mean": "mean over the recordings, each by the weight of its error",
    "median": "middle value over the recordings",
    "scatter / error": "how much the recordings differ over what their errors explain; about 1 for a fault that stays",
    "matters from": "size from which on it changes results",
    "drift by arcs": "speed of the drift over ground, from arcs of the circle one turn apart",
    "towards": "direction of that drift, clockwise from north",
    "error in a turn [% of diameter]": "error of the drift in one turn over the diameter",
    "track less u, v": "mean velocity of the track less that of u and v: a current, if u and v are through the water",
    "wind, mean": "mean of the recorded wind",
    "settings": "what to write into the mapping",
    # what to sail next
    "min": "duration [minutes]",
    "dev/L now": "expected largest distance between tracks over L by what has been recorded, mean of the targets",
    "errors now": "standard error of a term's force over the noise of a sample by what is recorded, geometric mean",
    "then": "the same after this manoeuvre too",
    "gain": "what it is expected to bring: deviation over L that it takes away, or for coefficients the growth of half "
    "the log determinant of the information, a coefficient",
    "gain/min": "the same a minute of trial",
    "after": "manoeuvre that is sailed next",
    # diagnosis
    "cause": "what the calm-water model may leave out; a star: it is in the repaired model",
    "probability": "of being present, given these recordings and the candidates that were tried",
    "found ± standard error": "value of each parameter",
    "when": "times at which it acts in each run",
    "acts on": "X surge, Y sway, N yaw, or the instrument, rudder or shaft",
    "ln B": "log Bayes factor over calm water of the best hypothesis with this cause: above 0 it speaks for the cause",
    "parameter": "what was estimated",
    "found": "value with its standard error",
    "95 % interval": "where the value lies with a probability of 95 %",
    "positive is": "which way a positive value goes",
    "RMS error": "root mean square over the samples after the warm-up, then over the held-out runs",
    "calm water": "of the model as it was given",
    "effects alone": "of the model with the effects found and the published coefficients",
    "repaired": "of the model with the effects found and the coefficients that the fitted runs make likely",
    "measurement noise": "its RMS as estimated for the fitted runs; a model that is right comes near it; a dash: not"
    " known",
    "site": "where a force of any kind was allowed",
    "ln B over calm water": "log Bayes factor of allowing it there",
    "test": "what a claim must pass",
    "passed": "whether it did",
    "how it is recognised": "by what this cause differs from others",
    "source": "where its formula is from",
    "setting": "name of the setting",
}  # fmt: skip
"""Heading -> what stands in the column."""
PATTERNS = (
    (r"nRMSE (.*)", r"root mean square error of {0} over its standard deviation in the recording"),
    (r"RMS \[(.*)\]", r"root mean square error in {0}"),
    (r"RMS (.+) \[(.*)\]", r"root mean square error of the records of {0} in {1}"),
    (r"RMS (.+)", r"root mean square error of the records of {0}"),
    (r"dev/L (.+)", r"largest distance between predicted and recorded track of {0} over the ship's length L"),
    (r"mean error \[(.*)\]", r"mean of predicted less recorded in {0}"),
    (r"largest \[(.*)\]", r"largest error in {0}"),
    (r"(.*) / noise", r"RMS error, {0}, over the estimated measurement noise: about 1 for a model that is right; below"
     r" 1 where that estimate is high or the channel was smoothed; a dash: measurement noise not known"),
)  # fmt: skip
"""Headings that hold a name, and what stands in such a column."""
OTHERS = "*"
"""In place of a heading: all that a table has beside those that are named."""
_OUTCOME = {
    "run": "folder of the run, below the folder that all of them share",
    "job": "folder of the run",
    "verdict": "what the model may be used for, by its held-out manoeuvres: usable, doubtful, do not use",
    "status": "finished; N ended early: as many held-out manoeuvres could not be predicted to their end; unfinished:"
    " not ended yet, or stopped; failed: and why",
    "ended early": "held-out manoeuvres that could not be predicted to their end",
    "mean dev/L": "mean over the held-out manoeuvres of the largest distance between tracks over L",
    "worst": "held-out manoeuvre with the largest distance, and that distance over L",
    "seconds": "time that the training took",
    "seed": "number that the random start comes from",
}
"""What came out of a run of training."""
_INTERVAL = {"from": "lower end of the 95 % interval", "to": "upper end of the 95 % interval"}
OF_TABLE: Mapping[str, Mapping[str, str]] = {
    JOBS: {**_OUTCOME, OTHERS: "setting that differs between jobs"},
    RUNS: {**_OUTCOME, OTHERS: "setting that differs between runs; runs.csv has its full name"},
    RUNS_BY_MANOEUVRE: {**_OUTCOME},
    RUNS_BY_SETTING: {**_OUTCOME, OTHERS: "setting that differs between runs; runs.csv has its full name"},
    "Deviation over L of each target": {
        "after": "manoeuvre that is sailed next; the first row: nothing more is sailed",
        OTHERS: "expected dev/L of this manoeuvre",
    },
    "Standard errors of each equation": {
        "after": "manoeuvre that is sailed next; the first row: nothing more is sailed",
        OTHERS: "standard error of a force over the noise of a sample, geometric mean",
    },
    "What each candidate is expected to bring": {
        "status": "ok: the model sails it to its end; else why it was ended",
    },
    "IMO MSC.137(76), predicted": {
        "criterion": "the manoeuvre and what the resolution limits in it",
        "value": "as the model predicts it",
        "verdict": "met, not met, or why it is not judged",
    },
    "What follows from them": _INTERVAL,
    "Settings": {"value": "what it was set to"},
}
"""Heading of a table -> what its columns say that elsewhere say something else."""


def explained(column: str, table: str = "") -> str:
    """What a column says, in a line; empty if its heading is not known.

    Args:
        column: Heading of the column.
        table: Heading of the table.

    Returns:
        The line.
    """
    own = OF_TABLE.get(table, {})
    # A setting may be called like a column of another table, such as u or value.
    known = own if OTHERS in own else {**EXPLAINED, **own}
    if column in known:
        return known[column]
    for pattern, words in PATTERNS:
        if found := re.fullmatch(pattern, column):
            return words.format(*found.groups())
    return own.get(OTHERS, "")
