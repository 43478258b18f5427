"""Results of the methods of Scene: objects with named fields in SI units. A result of one row lacks the first dimension N."""
from __future__ import annotations

import dataclasses
import math
from typing import Any, Dict, List, Optional, Union

import numpy as np

Flags = Union[bool, np.ndarray]


class Result:
    """Base of all results."""

    @classmethod
    def of(cls, found: Dict[str, Any]) -> Any:
        """The result whose fields a dict has, among others."""
        return cls(**{field.name: found[field.name] for field in dataclasses.fields(cls)})  # type: ignore[arg-type]

    def to_dict(self) -> Dict[str, Any]:
        """The fields by name; arrays are not copied."""

        def plain(value: Any) -> Any:
            if isinstance(value, Result):
                return value.to_dict()
            return [plain(one) for one in value] if isinstance(value, list) else value

        return {field.name: plain(getattr(self, field.name)) for field in dataclasses.fields(self)}  # type: ignore[arg-type]


class Forward(Result):
    """Shapes at one row or N rows of pressures. Rows in which no shape balances the load hold NaN."""

    def __init__(self, numbers: np.ndarray, converged: Flags) -> None:
        """numbers: (k,) or (N, k) that hold the tips of all rows, then their quaternions, then their twists."""
        self._numbers, self._converged = numbers, converged

    def _part(self, before: int, *entry: int) -> np.ndarray:
        """The quantity of N rows before which there are so many numbers per row, as a view."""
        rows = len(self._numbers)
        flat = self._numbers.reshape(-1)[before * rows:(before + math.prod(entry)) * rows]
        return flat.reshape(rows, *entry)

    @property
    def tips(self) -> np.ndarray:
        """(3,) or (N, 3) positions of the tip, base frame [m]."""
        return self._numbers[:3] if self._numbers.ndim == 1 else self._part(0, 3)

    @property
    def quaternions_xyzw(self) -> np.ndarray:
        """(4,) or (N, 4) unit quaternions x, y, z, w of the tip's frame, base frame; w >= 0."""
        return self._numbers[3:7] if self._numbers.ndim == 1 else self._part(3, 4)

    @property
    def twists(self) -> np.ndarray:
        """(sections, 6) or (N, sections, 6) twist of each section over its length, v [m] and w [rad]; under load the mean."""
        if self._numbers.ndim == 1:
            return self._numbers[7:].reshape(-1, 6)
        return self._part(7, (self._numbers.shape[1] - 7) // 6, 6)

    @property
    def converged(self) -> Flags:
        """bool, or (N,) bools: whether a shape balances the load."""
        return self._converged

    def to_dict(self) -> Dict[str, Any]:
        """The fields by name; arrays are not copied."""
        return {name: getattr(self, name) for name in ("tips", "quaternions_xyzw", "twists", "converged")}

    def __len__(self) -> int:
        return 1 if self._numbers.ndim == 1 else len(self._numbers)

    def __repr__(self) -> str:
        return f"<helix_arm.Forward of {len(self)} row{'' if len(self) == 1 else 's'}>"


@dataclasses.dataclass(frozen=True)
class Curve(Result):
    """Points along the arm's base curve, `points` per row of pressures."""

    s: np.ndarray  #: (points,) in [0, sections]; section k covers [k, k + 1]
    positions: np.ndarray  #: (N, points, 3) base frame [m]; NaN where no shape balances the load
    quaternions_xyzw: np.ndarray  #: (N, points, 4) unit quaternions, base frame


@dataclasses.dataclass(frozen=True)
class Inverse(Result):
    """Pressures within the limits for wanted tips, poses or twists."""

    pressures_pa: np.ndarray  #: (N, n) [Pa]; of tendons, angles [rad]
    reached: Flags  #: (N,) whether the residual is within the tolerance
    status: Union[str, np.ndarray]  #: (N,) "reached", "unreachable" (the closest) or "not_converged"
    residual_m: Union[float, np.ndarray]  #: (N,) position error and 0.1 m per rad of rotation [m]
    position_error_m: Union[float, np.ndarray]  #: (N,) distance of the tip from the wanted one [m]
    active_limits: np.ndarray  #: (N, n) -1 lower, 1 upper, 0 none
    iterations: Union[int, np.ndarray]  #: (N,)


@dataclasses.dataclass(frozen=True)
class Jacobian(Result):
    """Derivatives of tip and twists.

    Rows of tip_by_*: velocity of the tip [m], then its angular velocity [rad], base frame. Those of twists_by_*: sections, then
    v [m] and w [rad] of the twist. Columns of *_by_stiffness: K_gamma, K_tau [m^2] and K_kappa [m^2] of each actuator; NaN
    where an entry of 0 would resist a motion that nothing else resists. Columns of *_by_load: a force [N], then a moment [N m]
    at the tip, which keep their directions in the base frame; None without K_eps of the arm. What jacobian(by=...) leaves out
    is None.
    """

    tip_by_pressures: Optional[np.ndarray]  #: (N, 6, n) per Pa; of tendons, per rad
    twists_by_pressures: Optional[np.ndarray]  #: (N, sections, 6, n)
    tip_by_lengths: Optional[np.ndarray]  #: (N, 6, n) per m of free length
    twists_by_lengths: Optional[np.ndarray]  #: (N, sections, 6, n)
    tip_by_stiffness: Optional[np.ndarray]  #: (N, 6, n, 3)
    twists_by_stiffness: Optional[np.ndarray]  #: (N, sections, 6, n, 3)
    tip_by_load: Optional[np.ndarray]  #: (N, 6, 6)
    twists_by_load: Optional[np.ndarray]  #: (N, sections, 6, 6)
    converged: Flags  #: (N,) whether a shape balances the load; the derivatives are NaN where not


@dataclasses.dataclass(frozen=True)
class Payload(Result):
    """The largest forces at N places of the tip in D directions. NaN where the tip is not reached without the force; the stiffness
    also at the edge of buckling."""

    directions: np.ndarray  #: (D, 3) unit vectors, base frame
    forces_n: np.ndarray  #: (N, D) [N]
    ends: np.ndarray  #: (N, D) "limits", "unstable", "unactuated" (no actuator acts against it), "unreached" or "none" (none found)
    limits: np.ndarray  #: (N, D, n) limits that end it: -1 lower, 1 upper, 0 none
    stiffness_n_per_m: np.ndarray  #: (N, D) force per motion of the tip along it, under the largest force [N/m]
    pressures_pa: np.ndarray  #: (N, D, n) that hold it [Pa]; of tendons, angles [rad]
    reached: Flags  #: (N,) whether the tip gets there without the force


@dataclasses.dataclass(frozen=True)
class Attainment(Result):
    """Whether N shapes can be held under loads."""

    attainable: Flags  #: (N,) whether the residual is within the tolerance
    pressures_pa: np.ndarray  #: (N, n) that hold the shape, or come closest [Pa]; of tendons, angles [rad]
    missing_force_n: np.ndarray  #: (N, 3) where most is missing, frame of the base curve there [N]
    missing_moment_nm: np.ndarray  #: (N, 3) likewise [N m]
    missing_s: Union[float, np.ndarray]  #: (N,) there, in [k, k + 1] along section k
    residual_n: Union[float, np.ndarray]  #: (N,) root mean square over s, as the force along the arm with the same energy [N]
    active_limits: np.ndarray  #: (N, n) limits without which less would be missing: -1 lower, 1 upper, 0 none
    largest_force_n: float  #: that a section can make [N]


@dataclasses.dataclass(frozen=True)
class Workspace(Result):
    """Tips at pressures drawn uniformly within the limits."""

    pressures_pa: np.ndarray  #: (points, n) [Pa]
    tips: np.ndarray  #: (points, 3) base frame [m]
    unbalanced: int  #: draws left out, as no shape balances the load there
    moved_per_kpa_m: Optional[np.ndarray]  #: (points,) tip displacement for 1 kPa in every pressure [m]
    moved_per_mm_m: Optional[np.ndarray]  #: (points,) for 1 mm in every free length [m]
    moved_per_percent_stiffness_m: Optional[np.ndarray]  #: (points,) for 1 % in every entry of the stiffness [m]
    extreme_pressures_pa: Optional[np.ndarray]  #: (7, n) of the farthest tips along -x, -y, -z, x, y, z and from the base
    extreme_tips: Optional[np.ndarray]  #: (7, 3) those tips [m]


@dataclasses.dataclass(frozen=True)
class Motion(Result):
    """The tip over time. A batch of rollouts has them as first dimension."""

    times_s: np.ndarray  #: (T,) [s]
    tips: np.ndarray  #: (T, 3) or (rollouts, T, 3) base frame [m]
    quaternions_xyzw: np.ndarray  #: (T, 4) or (rollouts, T, 4) x, y, z, w of the tip's frame; w >= 0
    steps: Union[int, np.ndarray]  #: number, or (rollouts,)
    energy_j: Dict[str, Any]  #: at the end [J], each a number or (rollouts,): kinetic + elastic + potential + dissipated = work


@dataclasses.dataclass(frozen=True)
class LinearMotion(Result):
    """Small motions about a rest: x' = A x + B u, tip - `tip` = C x, with x the deviation of the state (2 n,) from `state`."""

    A: np.ndarray  #: (2 n, 2 n) [1/s]
    B: np.ndarray  #: (2 n, actuators) by the effective pressures [1/(s Pa)]
    C: np.ndarray  #: (3, 2 n)
    state: np.ndarray  #: (2, n) coordinates and rates at rest
    tip: np.ndarray  #: (3,) there, base frame [m]
    frequencies_hz: np.ndarray  #: natural frequencies of the vibrations, slowest first [Hz]
    damping_ratios: np.ndarray  #: theirs


@dataclasses.dataclass(frozen=True)
class Fit(Result):
    """Shapes fitted to the tags of N captures. Rows without a fit hold NaN."""

    captures: np.ndarray  #: (N,) numbers in the data set
    pressures_pa: np.ndarray  #: (N, n)
    status: np.ndarray  #: (N,) "converged", "not_converged", "underdetermined" or "unexplained"
    twists: np.ndarray  #: (N, sections, 6) v [m], w [rad]
    covariances: np.ndarray  #: (N, 6 sections, 6 sections) of the twists [m, rad]
    tips: np.ndarray  #: (N, 3) base frame [m]
    quaternions_xyzw: np.ndarray  #: (N, 4)
    tip_covariances: np.ndarray  #: (N, 3, 3) [m^2]
    rms: np.ndarray  #: (N,) over the tags that fit: positions [m], of corners [px]
    outlier_tags: List[List[int]]  #: ids of the tags that do not fit, per capture


@dataclasses.dataclass(frozen=True)
class Evaluation(Result):
    """The model against measurements."""

    kind: str  #: "curvatures", "tags" or "series"
    unit: str  #: of all errors: rad of curvatures, else m
    errors: np.ndarray  #: (N,) of a curvature, model minus measured; else distances of tips, per capture or position; NaN where none is
    rms: float
    median: float  #: of their sizes
    worst: float


@dataclasses.dataclass(frozen=True)
class Sight(Result):
    """The shape that one picture shows. Without a measured shape its fields hold NaN."""

    state: str  #: "measured", "no_tags", "too_few_tags" or "no_fit"
    twists: np.ndarray  #: (sections, 6) v [m], w [rad]
    covariance: np.ndarray  #: (6 sections, 6 sections) of the twists [m, rad]
    tip: np.ndarray  #: (3,) base frame [m]
    quaternion_xyzw: np.ndarray  #: (4,)
    tip_covariance: np.ndarray  #: (3, 3) [m^2]
    rms_px: float  #: of the corners that fit [px]
    tags: np.ndarray  #: (tags,) ids of all detections
    corners_px: np.ndarray  #: (tags, 4, 2) x, y of their corners [px]
    outlier_tags: List[int]  #: ids of those that do not fit
    unknown_tags: List[int]  #: ids that the scene does not have
    repeated_tags: List[int]  #: ids that are seen more than once


@dataclasses.dataclass(frozen=True)
class Parameter(Result):
    """A calibrated parameter, in SI units."""

    name: str  #: K_kappa, length_scale, base_x, tag_7_s, ...
    unit: str  #: m^2, m, rad, or empty
    initial: float
    value: float
    standard_error: Optional[float]  #: None with errors=False
    identifiable: Optional[bool]  #: whether the data determine it; None with errors=False


@dataclasses.dataclass(frozen=True)
class Combination(Result):
    """A product of powers of stiffness parameters whose error is not correlated with that of the others."""

    name: str  #: "K_gamma^0.97 K_kappa^0.25"
    exponents: Dict[str, float]  #: a unit vector
    value: float  #: in SI units
    relative_error: float  #: standard deviation of its logarithm
    identifiable: bool  #: whether the data determine it


@dataclasses.dataclass(frozen=True)
class Contraction(Result):
    """A fitted contraction curve."""

    name: str
    coefficients_m: List[float]  #: of a quintic over p / reference_pressure_pa
    reference_pressure_pa: float
    rms_m: float


@dataclasses.dataclass(frozen=True)
class Suspect(Result):
    """A usual mistake that would explain why a fit stays beyond the noise of its data."""

    cause: str  #: a word of docs/calibration.md, such as channels_exchanged
    where: str
    explains: float  #: share of what is beyond the noise
    remedy: str


@dataclasses.dataclass(frozen=True)
class Calibration(Result):
    """Result of a calibration."""

    success: bool
    message: str  #: the result in one line, or cause and remedy
    parameters: List[Parameter]
    correlation: Optional[np.ndarray]  #: (parameters, parameters); None with errors=False, as held_out_error and next_pressures_pa
    combinations: List[Combination]  #: of correlated stiffness parameters, the best known first; none with errors=False
    error_unit: str  #: of rms and held_out_error: rad, px or m
    rms: Optional[float]
    held_out_error: Optional[float]  #: of pressures that were left out of the fit
    next_pressures_pa: Optional[np.ndarray]  #: (k, n) the most informative pressures to measure next
    contractions: List[Contraction]
    tip_error_before_m: Optional[float]
    tip_error_after_m: Optional[float]
    suspects: List[Suspect]  #: best first
    warnings: List[str]
    scene_text: str  #: of the calibrated scene; empty without success

    def __repr__(self) -> str:
        rows = [f"{one.name} = {one.value:.6g}" + (f" +- {one.standard_error:.2g}" if one.standard_error else "") +
                (f" {one.unit}" if one.unit else "") + (", which the data do not determine" if one.identifiable is False else "")
                for one in self.parameters]
        return "\n    ".join([f"<helix_arm.Calibration: {'success' if self.success else self.message}", *rows]) + ">"

    def __getitem__(self, name: str) -> Parameter:
        """A parameter by its name. Raises KeyError."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise KeyError(f"{name}; there are {', '.join(one.name for one in self.parameters)}")


@dataclasses.dataclass(frozen=True)
class Alarm(Result):
    """A contact that the loop found."""

    time_s: float
    onset_s: float
    force_n: np.ndarray  #: (3,) base frame [N], or per K_eps if normalised
    covariance: np.ndarray  #: (3, 3)
    normalised: bool  #: the scene has no K_eps


@dataclasses.dataclass(frozen=True)
class Budget(Result):
    """The error budget of a picture: where the uncertainty of the tip comes from."""

    time_s: float  #: of the picture
    covariances_m2: Dict[str, np.ndarray]  #: (3, 3) of the tip, base frame, by part; "predicted" and "open_loop" are sums
    error_m: np.ndarray  #: (3,) measured tip minus that of the scene, base frame
    distance2: float  #: squared Mahalanobis distance of the error
    limit: float  #: of distance2
    state: str  #: "inside" or "outside"


@dataclasses.dataclass(frozen=True)
class FollowRun(Result):
    """A simulated run, one row per step of 10 ms. Positions in the base frame [m]; NaN where there is none."""

    times_s: np.ndarray  #: (T,)
    wanted_tips: np.ndarray  #: (T, 3)
    true_tips: np.ndarray  #: (T, 3)
    measured_tips: np.ndarray  #: (T, 3) in the steps in which a measurement arrives
    measured_times_s: np.ndarray  #: (T,) times of their pictures
    predicted_tips: np.ndarray  #: (T, 3) by the corrected model
    pressures_pa: np.ndarray  #: (T, n) true
    states: np.ndarray  #: (T,) of the loop
    path_times_s: np.ndarray  #: (T,) since the path's start
    unreachable: np.ndarray  #: (T,) whether the wanted tip is out of reach
    load_scores: np.ndarray  #: (T,) of a force on the arm
    path_rms_m: Optional[float]  #: error of the true tip from the path's start to its end
    path_max_m: Optional[float]
    last_turn_rms_m: Optional[float]  #: of a closed path's last turn
    steady_rms_m: List[float]  #: of each tip's last second
    settle_s: List[Optional[float]]  #: of each tip: time until within 2 mm + 5 % for good
    alarms: List[Alarm]
    pictures: int  #: accepted
    vented: str  #: why the safety core vented the arm; empty if it did not
    reason: str  #: why there are no figures, or none of a closed loop; empty if there are
    budget: Optional[Budget]  #: at the last accepted picture
    suspects: List[Suspect]  #: usual mistakes that explain the pictures, best first
