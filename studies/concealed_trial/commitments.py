"""Commitments: answers are drawn, hashed and forgotten; whoever opens them can prove that they are the same."""

import json
from collections.abc import Mapping
from hashlib import sha256
from typing import Any

from manoeuvre_nn.core.errors import InputError

METHOD = "sha256 over salt followed by the answer as JSON with sorted keys"
"""How it is done, in words."""


def commitment(salt: str, answers: Mapping[str, Any]) -> str:
    """Hash of a salted answer.

    Args:
        salt: Salt of the case.
        answers: What was concealed.

    Returns:
        sha256 of the salt and the answer as JSON with sorted keys.
    """
    return sha256((salt + json.dumps(answers, sort_keys=True)).encode()).hexdigest()


def check(commitments: Mapping[str, str], salt: str, answers: Mapping[str, Any]) -> None:
    """Refuse an answer that is not the one that was committed to.

    Args:
        commitments: Hash of each case.
        salt: Salt of the case.
        answers: What is said to have been concealed.

    Raises:
        InputError: If the case is not there or its hash differs.
    """
    case = str(answers["case"])
    if case not in commitments:
        raise InputError(f"case {case} is not in commitments.json: give the seed that the trial was made with")
    if commitments[case] != commitment(salt, answers):
        raise InputError(f"the answer of case {case} is not the one in commitments.json: draw the trial again")
