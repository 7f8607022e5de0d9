# What `_deacal`, written in Rust, has. tests/test_stubs.py holds it against the module.
from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal, Optional, Union

import numpy as np
import numpy.typing as npt
import pandas
import xarray

_Path = Union[str, PathLike[str]]
_Recordings = Union[_Path, Recording, Iterable[Union[_Path, Recording]]]
_Parameters = Union[_Path, ParameterFile, Fit, Diagnosis]
_Progress = Union[bool, Callable[[str, Optional[float]], object], None]
_Array = npt.NDArray[np.float64]

__version__: str

class DeacalError(Exception): ...

class Recording:
    @property
    def id(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def path(self) -> Path: ...
    @property
    def rig(self) -> Optional[str]: ...
    @property
    def time_s(self) -> Optional[_Array]: ...
    @property
    def positions(self) -> Optional[_Array]: ...
    @property
    def voltage_time_s(self) -> Optional[_Array]: ...
    @property
    def voltages(self) -> Optional[_Array]: ...
    @property
    def units(self) -> dict[str, str]: ...
    @property
    def clocks(self) -> dict[str, Optional[str]]: ...
    @property
    def gaps(self) -> list[tuple[float, int]]: ...
    @property
    def notes(self) -> list[str]: ...
    def keys(self) -> list[str]: ...
    def __contains__(self, name: str) -> bool: ...
    def __getitem__(self, name: str) -> _Array: ...
    def check(self) -> list[dict[str, Any]]: ...
    def aligned(self, plan: Optional[_Path] = None, *, progress: _Progress = None) -> Table: ...
    def to_pandas(self, clock: str = "time_s") -> pandas.DataFrame: ...
    def to_xarray(self) -> xarray.Dataset: ...

class Table:
    @property
    def flags(self) -> list[str]: ...
    def keys(self) -> list[str]: ...
    def __len__(self) -> int: ...
    def __contains__(self, name: str) -> bool: ...
    def __getitem__(self, name: str) -> _Array: ...
    def to_pandas(self) -> pandas.DataFrame: ...
    def to_xarray(self) -> xarray.Dataset: ...

class Prediction(Table):
    @property
    def id(self) -> str: ...
    @property
    def says(self) -> str: ...
    @property
    def remarks(self) -> list[str]: ...
    def save(self, path: _Path, *, full: bool = False, force: bool = False) -> None: ...

class Simulated(Table):
    @property
    def voltage_time_s(self) -> _Array: ...
    @property
    def voltages(self) -> _Array: ...
    @property
    def effects(self) -> list[dict[str, Any]]: ...
    @property
    def remarks(self) -> list[str]: ...
    def save(self, folder: _Path, *, force: bool = False) -> dict[str, Any]: ...

class Parameter:
    @property
    def name(self) -> str: ...
    @property
    def value(self) -> float: ...
    @property
    def unit(self) -> str: ...
    @property
    def std_error(self) -> Optional[float]: ...
    @property
    def ci95(self) -> Optional[tuple[float, float]]: ...
    @property
    def at_bound(self) -> Optional[str]: ...
    @property
    def identifiable(self) -> bool: ...
    @property
    def fixed(self) -> bool: ...
    @property
    def meaning(self) -> str: ...
    @property
    def says(self) -> str: ...
    def __float__(self) -> float: ...

class ParameterFile:
    @staticmethod
    def read(path: _Path) -> ParameterFile: ...
    @property
    def text(self) -> str: ...
    def to_dict(self) -> dict[str, Any]: ...
    def save(self, path: _Path, *, force: bool = False) -> None: ...

class Result:
    @property
    def json(self) -> dict[str, Any]: ...
    @property
    def remarks(self) -> list[str]: ...
    @property
    def files(self) -> list[str]: ...
    def report(self) -> str: ...
    def save(self, folder: _Path, *, force: bool = False) -> list[Path]: ...
    def _repr_html_(self) -> str: ...

class Fit(Result):
    @property
    def job(self) -> str: ...
    @property
    def says(self) -> str: ...
    @property
    def parameters(self) -> dict[str, Parameter]: ...
    @property
    def free(self) -> list[str]: ...
    @property
    def correlation(self) -> _Array: ...
    @property
    def covariance(self) -> _Array: ...
    @property
    def converged(self) -> bool: ...
    @property
    def rmse(self) -> Optional[float]: ...
    @property
    def rmse_unit(self) -> str: ...
    @property
    def parameter_file(self) -> ParameterFile: ...

class Diagnosis(Result):
    @property
    def verdict(self) -> str: ...
    @property
    def confidence(self) -> Optional[float]: ...
    @property
    def says(self) -> str: ...
    @property
    def candidates(self) -> list[dict[str, Any]]: ...
    @property
    def places(self) -> list[dict[str, Any]]: ...
    @property
    def findings(self) -> list[dict[str, Any]]: ...
    @property
    def next_experiment(self) -> str: ...
    @property
    def parameter_file(self) -> Optional[ParameterFile]: ...

class Ageing(Result):
    @property
    def says(self) -> str: ...
    @property
    def electrodes(self) -> dict[str, Any]: ...
    @property
    def causes(self) -> dict[str, Any]: ...

def read(path: _Path, *, rig: Optional[_Path] = None, progress: _Progress = None) -> Recording: ...
def fit_film(
    recordings: _Recordings,
    *,
    start: Optional[_Parameters] = None,
    rig: Optional[_Path] = None,
    plan: Optional[_Path] = None,
    fix: Optional[Mapping[str, float]] = None,
    bound: Optional[Mapping[str, tuple[float, float]]] = None,
    branches: int = 6,
    starts: int = 5,
    seed: int = 1,
    robust: Optional[float] = None,
    progress: _Progress = None,
) -> Fit: ...
def fit_forearm(
    recordings: _Recordings,
    *,
    start: Optional[_Parameters] = None,
    rig: Optional[_Path] = None,
    plan: Optional[_Path] = None,
    fix: Optional[Mapping[str, float]] = None,
    bound: Optional[Mapping[str, tuple[float, float]]] = None,
    branches: int = 6,
    starts: int = 5,
    seed: int = 1,
    robust: Optional[float] = None,
    progress: _Progress = None,
) -> Fit: ...
def fit_robot(
    recordings: _Recordings,
    *,
    start: Optional[_Parameters] = None,
    rig: Optional[_Path] = None,
    plan: Optional[_Path] = None,
    fix: Optional[Mapping[str, float]] = None,
    bound: Optional[Mapping[str, tuple[float, float]]] = None,
    branches: int = 6,
    starts: int = 5,
    seed: int = 1,
    robust: Optional[float] = None,
    progress: _Progress = None,
) -> Fit: ...
def fit_sample(
    recordings: _Recordings,
    *,
    start: Optional[_Parameters] = None,
    rig: Optional[_Path] = None,
    fix: Optional[Mapping[str, float]] = None,
    bound: Optional[Mapping[str, tuple[float, float]]] = None,
    branches: int = 6,
    starts: int = 5,
    seed: int = 1,
    progress: _Progress = None,
) -> Fit: ...
def fit_coupon(
    recordings: _Recordings,
    *,
    fix: Optional[Mapping[str, float]] = None,
    bound: Optional[Mapping[str, tuple[float, float]]] = None,
    branches: int = 6,
    starts: int = 5,
    seed: int = 1,
    progress: _Progress = None,
) -> Fit: ...
def fit_hinge(
    recordings: _Recordings,
    *,
    fix: Optional[Mapping[str, float]] = None,
    bound: Optional[Mapping[str, tuple[float, float]]] = None,
    progress: _Progress = None,
) -> Fit: ...
def fit_axis(
    recordings: _Recordings,
    *,
    fix: Optional[Mapping[str, float]] = None,
    bound: Optional[Mapping[str, tuple[float, float]]] = None,
    objective: Literal["input", "motion"] = "input",
    cause: Sequence[str] = (),
    without: Sequence[str] = (),
    between: Optional[Literal["straight", "held", "smooth"]] = None,
    progress: _Progress = None,
) -> Fit: ...
def predict(
    recording: Union[_Path, Recording],
    parameters: _Parameters,
    what: Literal["voltage", "force", "motion"] = "voltage",
    *,
    rig: Optional[_Path] = None,
    plan: Optional[_Path] = None,
    begin: int = 0,
    progress: _Progress = None,
) -> Prediction: ...
def simulate(
    rig: _Path,
    parameters: _Parameters,
    *,
    drive: Optional[str] = None,
    voltage: Union[_Path, tuple[npt.ArrayLike, npt.ArrayLike], None] = None,
    path: Optional[_Path] = None,
    effects: Sequence[str] = (),
    duration: Optional[float] = None,
    drive_rate: float = 1000.0,
    flip_every: Optional[float] = None,
    hold_previous: bool = False,
    payload: Union[float, str, None] = None,
    limit: Optional[float] = None,
    noise: float = 0.0,
    coloured_noise: float = 0.0,
    noise_correlation: float = 0.1,
    gaps: Sequence[tuple[float, float]] = (),
    clock_offset: float = 0.0,
    stated_offset: Union[float, Literal["estimate"], None] = None,
    quantum: float = 0.1,
    rate: float = 100.0,
    seed: int = 1,
    id: str = "simulated",
    electrode: Optional[str] = None,
    batch: Optional[str] = None,
    day: Optional[int] = None,
    progress: _Progress = None,
) -> Simulated: ...
def diagnose(
    recordings: _Recordings,
    *,
    holdout: Optional[_Recordings] = None,
    rig: Optional[_Path] = None,
    plan: Optional[_Path] = None,
    only: Sequence[str] = (),
    false_alarms: float = 0.02,
    relevant: Optional[float] = None,
    rivals: bool = False,
    progress: _Progress = None,
) -> Diagnosis: ...
def ageing(
    recordings: _Recordings,
    *,
    by: Literal["day", "batch"] = "day",
    threshold: float = 5.0,
    loss: float = 50.0,
    cycles: int = 8,
    mount: Optional[float] = None,
    rig: Optional[_Path] = None,
    compare: Optional[Literal["paper"]] = None,
    progress: _Progress = None,
) -> Ageing: ...
