"""Checks of arguments: each raises TypeError or ValueError naming the argument and its rule."""
from __future__ import annotations

import math
import operator
import os
from typing import Any, List, Mapping, NoReturn, Optional, Tuple, Union

import numpy as np

from helix_arm import _core

MOST_THREADS = 1024
MOST_DATA_ROWS, MOST_DATA_COLUMNS = 200_000, 1000  # as of a file


def refuse_type(given: Any, name: str, expected: str) -> NoReturn:
    raise TypeError(f"{name} is of type {type(given).__name__}; expected {expected}")


def require(holds: bool, message: str) -> None:
    if not holds:
        raise ValueError(message)


def integer(given: Any, name: str, lower: int, upper: int, expected: str = "") -> int:
    """An integer of Python or NumPy."""
    try:
        value = operator.index(given)
    except TypeError:
        refuse_type(given, name, "an int")
    if isinstance(given, bool):
        refuse_type(given, name, "an int")
    text = str(value) if abs(value) < 2**63 else "beyond 64 bits"
    require(lower <= value <= upper, f"{name} is {text}; expected {expected or f'{lower} to {upper}'}")
    return value


def threads(given: Any) -> int:
    """0 stands for all cores."""
    if given.__class__ is int and 0 <= given <= MOST_THREADS:  # without the calls below
        return given
    return integer(given, "threads", 0, MOST_THREADS, f"1 to {MOST_THREADS}, or 0 for all cores")


def number(given: Any, name: str, lower: float = -math.inf, upper: float = math.inf, expected: str = "") -> float:
    """A number, of the range if there is one."""
    value = None
    try:
        if not isinstance(given, (str, bytes)):
            value = float(given)
    except (TypeError, ValueError, OverflowError):
        pass
    if value is None:
        refuse_type(given, name, "a number")
    if lower > -math.inf:
        holds = lower <= value <= upper and value < math.inf
        require(holds, f"{name} is {value:g}; expected {expected or f'{lower:g} to {upper:g}'}")
    return value


def flag(given: Any, name: str) -> bool:
    if not isinstance(given, bool):
        refuse_type(given, name, "True or False")
    return given


def text(given: Any, name: str) -> str:
    if not isinstance(given, str):
        refuse_type(given, name, "a str")
    try:
        given.encode()
    except UnicodeEncodeError:
        raise ValueError(f"{name} is {repr(given)[:60]}, which UTF-8 cannot hold; expected text without surrogates") from None
    return given


def items(given: Any, name: str, expected: str) -> List[Any]:
    try:
        if not isinstance(given, (str, bytes)):
            return list(given)
    except TypeError:
        pass
    refuse_type(given, name, expected)


def words(given: Any, name: str, example: str) -> List[str]:
    """One word or several."""
    found = [given] if isinstance(given, str) else items(given, name, f"a list of words, such as [\"{example}\"]")
    return [text(word, f"{name}[{i}]") for i, word in enumerate(found)]


def rows(given: Any, name: str, columns: int, fewest: int = 1, most: int = 1) -> Optional[np.ndarray]:
    """Finite numbers (N, columns) of one row or so many; None of None."""
    if given is None:
        return None
    array = np.atleast_2d(_core.rows(given, name, columns))
    expected = "one" if most == 1 else f"{fewest} to {most}"
    require(fewest <= len(array) <= most, f"{name} has {len(array)} rows; expected {expected}")
    _core.require_finite(array, name)
    return array


def apart(pressures: np.ndarray, out: Any) -> np.ndarray:
    """The pressures, for whose tips there is such an array, in other memory."""
    shape = (*pressures.shape[:-1], 3)
    fits = isinstance(out, np.ndarray) and out.dtype == np.float64 and out.shape == shape and out.flags.carray
    require(fits, f"out is no array for the result; expected a writeable float64 array of shape {shape} in the order of C")
    require(not np.may_share_memory(pressures, out), "out overlaps pressures_pa; expected memory of its own")
    return pressures


def data_set(given: Any, name: str) -> Union[str, Tuple[str, List[str], np.ndarray, List[str]]]:
    """A data set: its path; or of a dict, the name, the names of columns, their numbers (rows, columns), and the names of the trials
    if the column trial holds texts, whose numbers are their indices."""
    if isinstance(given, os.PathLike):
        given = os.fspath(given)
    if isinstance(given, str):
        return text(given, name)
    if not isinstance(given, Mapping):
        refuse_type(given, name, "the path of a data set, or a dict of its columns")
    require(1 <= len(given) <= MOST_DATA_COLUMNS, f"{name} has {len(given)} columns; expected 1 to {MOST_DATA_COLUMNS}")
    columns: List[np.ndarray] = []
    trials: List[str] = []
    for key, values in given.items():
        where = f"{name}[\"{text(key, f'a name of a column of {name}')[:60]}\"]"
        if key == "trial" and all(isinstance(one, str) for one in np.ravel(values)):
            trials = [text(one, where) for one in dict.fromkeys(np.ravel(values).tolist())]
            values = np.vectorize({one: k for k, one in enumerate(trials)}.get, otypes=[float])(values)
        array = _core.array(values, where)
        fits = array.ndim == 1 and 0 < len(array) <= MOST_DATA_ROWS and (not columns or len(array) == len(columns[0]))
        require(fits, f"{where} has shape {array.shape}; expected 1 to {MOST_DATA_ROWS} numbers, as many as the other columns")
        _core.require_finite(array, where)
        columns.append(array)
    return name, list(given), np.column_stack(columns), trials


def pictures(given: Any, shape: Tuple[int, int]) -> np.ndarray:
    """Gray pictures (N, height, width) of one (height, width) or several."""
    if not isinstance(given, np.ndarray) or given.dtype != np.uint8:
        raise TypeError("image is no array of bytes; expected a gray picture of dtype uint8, as of "
                        "image.mean(axis=2).astype(np.uint8)")
    height, width = shape
    require(given.ndim in (2, 3) and given.shape[-2:] == shape, f"image has shape {given.shape}; expected gray pictures of the "
            f"scene's camera: ({height}, {width}) or (N, {height}, {width})")
    return np.ascontiguousarray(given if given.ndim == 3 else given[np.newaxis])
