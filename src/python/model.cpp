#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include <pybind11/stl.h>

#include "bindings.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/batch.hpp"
#include "helix_arm/statics/attain.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/statics/jacobian.hpp"
#include "helix_arm/statics/payload.hpp"
#include "helix_arm/statics/workspace.hpp"

namespace helix_arm::python {
namespace {

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
// About 0.1 ms in closed form; tips alone are fast.
constexpr Piece kForwardPiece{1024, 16}, kTipsPiece{16384, 16}, kCurvePiece{64, 8},
    kJacobianPiece{16, 1};

// Tips, then quaternions, then twists of all rows in one array, as making three takes as long as a
// row; and whether the rows have an equilibrium: the others hold NaN.
py::tuple forward(const Scene& scene, const py::handle& pressures, std::size_t threads) {
  const Rows inputs = scene.inputs(pressures, "pressures_pa");
  const int size = 6 * scene.arm().sectionCount();
  const Entries<double> numbers(inputs, {7 + size});
  const Entries<bool> converged(inputs, {});
  double* const tips = numbers.at(0);
  double *const quaternions = tips + 3 * inputs.rows(), *const shapes = tips + 7 * inputs.rows();
  const auto set = [&](std::size_t row, bool found, const lie::SE3& tip,
                       const model::Twists& twists) {
    converged[row] = found;
    setPose(tip, found, tips + 3 * row, quaternions + 4 * row);
    if (found) {
      std::copy_n(twists.data(), size, shapes + size * row);
    } else {
      std::fill_n(shapes + size * row, size, kNoNumber);
    }
  };
  forEachRow(scene, inputs, kForwardPiece, threads, [&](std::size_t row, const auto& q) {
    if (scene.isLoaded()) {
      const statics::Solution solution = scene.model().solve(q);
      set(row, solution.converged(), solution.tip, solution.shape.twists());
    } else {
      const model::Twists twists = scene.arm().twists(q);
      set(row, true, scene.arm().tipOf(twists), twists);
    }
  });
  return py::make_tuple(numbers.result(), converged.result());
}

void tipsOfBatch(const Scene& scene, const model::TipBatch& batch, const Rows& inputs,
                 std::size_t first, std::size_t end, double* out) {
  model::InputArray array{reinterpret_cast<const double*>(inputs.data()), inputs.rowStride(),
                          inputs.columnStride()};
  array.first = array.place(first, 0);
  if (batch.rows(array, end - first, out + 3 * first)) return;
  Eigen::VectorXd q;
  for (py::ssize_t row = 0; row < inputs.rows(); ++row) scene.copyRow(inputs, row, &q);  // throws
}

// Tip positions [m], shape (3,) or (N, 3). Rows without equilibrium hold NaN.
// @param out  array for them, which fits, or none: a new one.
py::array tips(const Scene& scene, const py::handle& pressures, const py::object& out,
               std::size_t threads) {
  const Rows inputs = scene.inputs(pressures, "pressures_pa");
  const std::vector<py::ssize_t> shape = inputs.shapeOf({3});
  const py::array result =
      out.is_none() ? py::array_t<double>(shape) : py::reinterpret_borrow<py::array>(out);
  auto* const numbers = static_cast<double*>(const_cast<void*>(result.data()));
  if (scene.isLoaded() || inputs.rows() == 1) {
    forEachRow(scene, inputs, kTipsPiece, threads, [&](std::size_t row, const auto& q) {
      const statics::Tip found = scene.model().tip(q);
      Eigen::Vector3d::Map(numbers + 3 * row) =
          found.converged() ? found.tip.translation : Eigen::Vector3d::Constant(kNoNumber);
    });
    return result;
  }
  const OthersRun others_run;
  const model::TipBatch batch(scene.arm());
  inPieces(static_cast<std::size_t>(inputs.rows()), kTipsPiece.closed_form, threads,
           [&](std::size_t first, std::size_t end) {
             tipsOfBatch(scene, batch, inputs, first, end, numbers);
           });
  return result;
}

py::dict curve(const Scene& scene, const py::handle& pressures, int points, std::size_t threads) {
  const Rows inputs = scene.inputs(pressures, "pressures_pa");
  const Entries<double> positions(inputs, {points, 3}), quaternions(inputs, {points, 4});
  forEachRow(scene, inputs, kCurvePiece, threads, [&](std::size_t row, const auto& q) {
    const bool found = !scene.isLoaded() || scene.model().tip(q).converged();
    double *position = positions.at(row), *quaternion = quaternions.at(row);
    for (const auto& point : scene.model().curve(q, points)) {
      setPose(point.X, found, position, quaternion);
      position += 3;
      quaternion += 4;
    }
  });
  return py::dict("positions"_a = positions.result(), "quaternions_xyzw"_a = quaternions.result());
}

// Tip and twists by one quantity.
struct Derivative {
  using Table = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  Derivative(const Rows& inputs, int sections, std::vector<py::ssize_t> by)
      : tip(inputs, shapeOf({6}, by)), twists(inputs, shapeOf({sections, 6}, by)) {}
  static std::vector<py::ssize_t> shapeOf(std::vector<py::ssize_t> of,
                                          const std::vector<py::ssize_t>& by) {
    of.insert(of.end(), by.begin(), by.end());
    return of;
  }
  void set(std::size_t row, const statics::ShapeDerivative& derivative) const {
    Table::Map(tip.at(row), 6, tip.size() / 6) = derivative.tip;
    Table::Map(twists.at(row), derivative.twists.rows(), tip.size() / 6) = derivative.twists;
  }

  Entries<double> tip, twists;
};

// @param by  which are wanted: by pressures, lengths, stiffness and load.
// @return whether the rows converged, and the derivatives of tip and twists by each of these.
py::tuple jacobian(const Scene& scene, const py::handle& pressures, const std::array<bool, 4>& by,
                   std::size_t threads) {
  const Rows inputs = scene.inputs(pressures, "pressures_pa");
  const py::ssize_t n = scene.arm().actuatorCount();
  const auto make = [&](bool wanted, const std::vector<py::ssize_t>& columns) {
    std::optional<Derivative> out;
    if (wanted) out.emplace(inputs, scene.arm().sectionCount(), columns);
    return out;
  };
  const std::array<std::optional<Derivative>, 4> found{make(by[0], {n}), make(by[1], {n}),
                                                       make(by[2], {n, 3}),
                                                       make(by[3] && scene.model().load(), {6})};
  const statics::JacobianParts parts{found[2].has_value(), found[3].has_value()};
  const Entries<bool> converged(inputs, {});
  forEachRow(scene, inputs, kJacobianPiece, threads, [&](std::size_t row, const auto& q) {
    const statics::ShapeJacobian one = statics::jacobianAt(scene.model(), q, parts);
    converged[row] = one.status == statics::SolveStatus::kConverged;
    if (found[0]) found[0]->set(row, one.by_inputs);
    if (found[1]) found[1]->set(row, one.by_lengths);
    if (found[2]) found[2]->set(row, *one.by_stiffness);
    if (found[3]) found[3]->set(row, *one.by_load);
  });
  py::list out;
  for (const auto& one : found) {
    out.append(one ? one->tip.result() : py::none());
    out.append(one ? one->twists.result() : py::none());
  }
  return py::make_tuple(converged.result(), out);
}

// @return the points in pieces: pressures, tips and sensitivities; how many are left out;
// pressures,
//     and tips of the extremes, if they are wanted and there are any.
py::tuple workspace(const Scene& scene, std::size_t count, std::uint64_t seed, bool sensitivity,
                    bool extremes, std::size_t threads) {
  std::vector<statics::WorkspacePoints> pieces;
  statics::WorkspaceExtremes farthest;
  {
    const OthersRun others_run;
    const statics::Workspace workspace(scene.model(), {seed, sensitivity});
    const auto size = static_cast<std::size_t>(workspace.pieceSize());
    pieces.resize(std::max<std::size_t>(1, (count + size - 1) / size));
    inPieces(pieces.size(), 1, threads, [&](std::size_t first, std::size_t end) {
      for (std::size_t i = first; i < end; ++i) {
        pieces[i] = workspace.sample(i * size, static_cast<int>(std::min(size, count - i * size)));
      }
    });
    if (extremes) {
      for (const statics::WorkspacePoints& piece : pieces) farthest.add(piece);
      farthest = statics::findExtremes(scene.model(), farthest);
    }
  }
  py::list points;
  int unbalanced = 0;
  for (statics::WorkspacePoints& piece : pieces) {
    points.append(
        py::make_tuple(arrayOf(piece.inputs), arrayOf(piece.tips), arrayOf(piece.sensitivity)));
    unbalanced += piece.unbalanced;
    piece = {};
  }
  if (farthest.empty()) return py::make_tuple(points, unbalanced, py::none());
  constexpr int kCount = statics::WorkspaceExtremes::kCount;
  Eigen::MatrixXd inputs(kCount, scene.arm().actuatorCount()), tips(kCount, 3);
  for (int i = 0; i < kCount; ++i) {
    inputs.row(i) = farthest.of(i).input;
    tips.row(i) = farthest.of(i).tip;
  }
  return py::make_tuple(points, unbalanced, py::make_tuple(arrayOf(inputs), arrayOf(tips)));
}

constexpr Piece kInversePiece{256, 16};
constexpr double kNormTolerance = 1e-3;  // more than the rounding of a few digits

lie::SE3 poseOf(const Eigen::VectorXd& p, std::size_t row) {
  const Eigen::Quaterniond q(p[6], p[3], p[4], p[5]);
  basics::require(std::abs(q.norm() - 1) <= kNormTolerance, "pose has a quaternion of norm ",
                  q.norm(), " in row ", row, "; expected 1, in the order x, y, z, qx, qy, qz, qw");
  return {q.normalized().toRotationMatrix(), p.head<3>()};
}

// -1 lower, 1 upper, 0 none.
void setLimits(const std::vector<statics::Limit>& limits, std::int8_t* out) {
  std::transform(limits.begin(), limits.end(), out, [](statics::Limit limit) -> std::int8_t {
    if (limit == statics::Limit::kNone) return 0;
    return limit == statics::Limit::kLower ? -1 : 1;
  });
}

// The results of all rows.
struct Found {
  Found(const Rows& rows, py::ssize_t actuators)
      : inputs(rows, {actuators}),
        residual(rows, {}),
        position_error(rows, {}),
        limits(rows, {actuators}),
        status(rows, {}),
        iterations(rows, {}) {}

  void set(std::size_t row, const statics::InverseResult& result) const {
    Eigen::VectorXd::Map(inputs.at(row), inputs.size()) = result.input;
    setLimits(result.limits, limits.at(row));
    residual[row] = result.residual;
    position_error[row] = result.position_error;
    status[row] = static_cast<std::int8_t>(result.status);
    iterations[row] = result.iterations;
  }

  Entries<double> inputs, residual, position_error;
  Entries<std::int8_t> limits, status;
  Entries<int> iterations;
};

// @param kind    "tip", "pose" or "twists": what the rows of `wanted` are, of 3, 7 or 6 n numbers.
// @param prefer  of statics::kPreferenceWords.
// @return fields of the result, of the status its place in statics::InverseStatus.
py::dict inverse(const Scene& scene, const std::string& kind, const py::object& wanted,
                 const py::object& start, const std::string& prefer, double cocontraction,
                 double position_tolerance, std::size_t threads) {
  const model::Arm& arm = scene.arm();
  const bool tip = kind == "tip", pose = kind == "pose";
  const Rows targets(wanted, kind.c_str(), tip ? 3 : pose ? 7 : 6 * arm.sectionCount());
  const auto count = static_cast<std::size_t>(targets.rows());
  const Found found(targets, arm.actuatorCount());  // first: rows may be more than memory holds
  statics::InverseOptions options;
  options.preference = statics::preferenceOf(prefer);
  options.cocontraction = cocontraction;
  options.position_tolerance = position_tolerance;

  std::optional<Rows> starts;
  if (!start.is_none()) {
    starts.emplace(scene.inputs(start, "start"));
    basics::require(starts->rows() == 1 || starts->rows() == targets.rows(), "start has ",
                    starts->rows(), " rows; expected one, or as many as ", kind, ": ",
                    targets.rows());
  }
  const bool cocontracts = options.preference == statics::Preference::kCocontraction;
  const Eigen::VectorXd usual = arm.inputAt(cocontracts ? options.cocontraction : 0.0);
  targets.requireFinite();
  {
    const OthersRun others_run;
    scene.solvers().take(options);  // checks them, also without rows
    const auto piece = scene.isLoaded() ? kInversePiece.solved : kInversePiece.closed_form;
    inPieces(count, piece, threads, [&](std::size_t first, std::size_t end) {
      const Solvers::Loan solver = scene.solvers().take(options);
      Eigen::VectorXd from = usual;
      for (std::size_t i = first; i < end; ++i) {
        const auto row = static_cast<py::ssize_t>(i);
        const Eigen::VectorXd target = targets.row(row);
        if (starts) scene.copyRow(*starts, starts->rows() == 1 ? 0 : row, &from);
        found.set(i, tip    ? solver->toPosition(target, from)
                     : pose ? solver->toPose(poseOf(target, i), from)
                            : solver->toTwists(target.reshaped(6, arm.sectionCount()), from));
      }
    });
  }
  return py::dict("pressures_pa"_a = found.inputs.result(), "status"_a = found.status.result(),
                  "residual_m"_a = found.residual.result(),
                  "position_error_m"_a = found.position_error.result(),
                  "active_limits"_a = found.limits.result(),
                  "iterations"_a = found.iterations.result());
}

constexpr std::size_t kPayloadPiece = 4;

// @param directions  (D, 3).
// @return fields of the result for each tip and direction, of the end its place in PayloadEnd.
py::dict payload(const Scene& scene, const py::object& wanted, const py::object& given_directions,
                 const std::array<double, 3>& moment, double tolerance, std::size_t threads) {
  const Rows tips(wanted, "tip", 3), directions(given_directions, "directions", 3);
  tips.requireFinite();
  directions.requireFinite();
  const py::ssize_t n = scene.arm().actuatorCount(), count = directions.rows();
  const Entries<double> forces(tips, {count}), stiffness(tips, {count}), inputs(tips, {count, n});
  const Entries<std::int8_t> limits(tips, {count, n}), ends(tips, {count});
  const Entries<bool> reached(tips, {});
  const statics::PayloadOptions options{tolerance, {moment[0], moment[1], moment[2]}};
  {
    const OthersRun others_run;
    statics::PayloadSolver(scene.model(), options);  // checks them, also without rows
    inPieces(static_cast<std::size_t>(tips.rows()), kPayloadPiece, threads,
             [&](std::size_t first, std::size_t end) {
               statics::PayloadSolver solver(scene.model(), options);
               for (std::size_t row = first; row < end; ++row) {
                 solver.moveTo(tips.row(static_cast<py::ssize_t>(row)));
                 reached[row] = solver.isThere();
                 for (py::ssize_t d = 0; d < count; ++d) {
                   const statics::Payload found = solver.along(directions.row(d));
                   forces.at(row)[d] = reached[row] ? found.force : kNoNumber;
                   stiffness.at(row)[d] = found.stiffness;
                   ends.at(row)[d] = static_cast<std::int8_t>(found.end);
                   Eigen::VectorXd::Map(inputs.at(row) + d * n, n) = found.input;
                   setLimits(found.limits, limits.at(row) + d * n);
                 }
               }
             });
  }
  return py::dict("forces_n"_a = forces.result(), "ends"_a = ends.result(),
                  "limits"_a = limits.result(), "stiffness_n_per_m"_a = stiffness.result(),
                  "pressures_pa"_a = inputs.result(), "reached"_a = reached.result());
}

constexpr std::size_t kAttainPiece = 64;

// @param wanted  rows of the twists of `pieces` per section. @param loads  rows of s, force, s,
//     moment: one, or one for each of the twists.
py::dict attain(const Scene& scene, const py::object& wanted, int pieces, const py::object& loads,
                double tolerance, std::size_t threads) {
  const model::Arm& arm = scene.arm();
  const int columns = pieces * arm.sectionCount();
  const Rows twists(wanted, "twists", 6 * columns), points(loads, "force and moment", 8);
  twists.requireFinite();
  points.requireFinite();
  basics::require(points.rows() == 1 || points.rows() == twists.rows(), "force and moment have ",
                  points.rows(), " rows; expected one, or as many as twists: ", twists.rows());
  basics::require(scene.model().load().has_value(),
                  "attain() needs arm.stiffness.K_eps_n in every section");
  const Entries<bool> attainable(twists, {});
  const Entries<double> inputs(twists, {arm.actuatorCount()}), force(twists, {3}),
      moment(twists, {3}), s(twists, {}), residual(twists, {});
  const Entries<std::int8_t> limits(twists, {arm.actuatorCount()});
  const statics::AttainSolver solver(arm, *scene.model().load(), tolerance);
  {
    const OthersRun others_run;
    inPieces(static_cast<std::size_t>(twists.rows()), kAttainPiece, threads,
             [&](std::size_t first, std::size_t end) {
               for (std::size_t i = first; i < end; ++i) {
                 const auto row = static_cast<py::ssize_t>(i);
                 const Eigen::VectorXd load = points.row(points.rows() == 1 ? 0 : row);
                 statics::PointLoad pull = statics::placeAt(arm, load[0]),
                                    turn = statics::placeAt(arm, load[4]);
                 pull.force = load.segment<3>(1);
                 turn.moment = load.tail<3>();
                 const model::Shape shape(
                     model::Shape::Pieces(twists.row(row).reshaped(6, columns)), pieces,
                     arm.links());
                 const statics::Attainment found = solver.attain(shape, {pull, turn});
                 attainable[i] = found.attainable;
                 Eigen::VectorXd::Map(inputs.at(i), inputs.size()) = found.input;
                 Eigen::Vector3d::Map(force.at(i)) = found.missing.force;
                 Eigen::Vector3d::Map(moment.at(i)) = found.missing.moment;
                 s[i] = found.missing.section + found.missing.s;
                 residual[i] = found.residual;
                 setLimits(found.limits, limits.at(i));
               }
             });
  }
  return py::dict("attainable"_a = attainable.result(), "pressures_pa"_a = inputs.result(),
                  "missing_force_n"_a = force.result(), "missing_moment_nm"_a = moment.result(),
                  "missing_s"_a = s.result(), "residual_n"_a = residual.result(),
                  "active_limits"_a = limits.result(), "largest_force_n"_a = solver.largestForce());
}

}  // namespace

void bindModel(py::class_<Scene>& scene) {
  scene.def("_forward", forward, "pressures_pa"_a, "threads"_a)
      .def("_tips", tips, "pressures_pa"_a, "out"_a, "threads"_a)
      .def("_curve", curve, "pressures_pa"_a, "points"_a, "threads"_a)
      .def("_jacobian", jacobian, "pressures_pa"_a, "by"_a, "threads"_a)
      .def("_inverse", inverse, "kind"_a, "wanted"_a, "start"_a, "prefer"_a, "cocontraction"_a,
           "position_tolerance_m"_a, "threads"_a)
      .def("_payload", payload, "tip"_a, "directions"_a, "moment"_a, "tolerance"_a, "threads"_a)
      .def("_attain", attain, "twists"_a, "pieces"_a, "loads"_a, "tolerance"_a, "threads"_a)
      .def("_workspace", workspace, "points"_a, "seed"_a, "sensitivity"_a, "extremes"_a,
           "threads"_a);
}

}  // namespace helix_arm::python
