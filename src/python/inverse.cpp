#include "helix_arm/statics/inverse.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <optional>
#include <sstream>

#include "bindings.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::python {
namespace {

using statics::InverseOptions;
using statics::InverseResult;
using statics::InverseSolver;
using statics::Preference;

constexpr std::size_t kPiece = 256;
constexpr std::size_t kLoadedPiece = 16;
constexpr double kNormTolerance = 1e-3;  // more than the rounding of a few digits

enum class Target { kTip, kPose, kTwists };

lie::SE3 poseOf(const Eigen::VectorXd& p, py::ssize_t row) {
  const Eigen::Quaterniond q(p[6], p[3], p[4], p[5]);
  basics::require(std::abs(q.norm() - 1) <= kNormTolerance, "pose has a quaternion of norm ",
                  q.norm(), " in row ", row, "; expected 1, in the order x, y, z, qx, qy, qz, qw");
  return {q.normalized().toRotationMatrix(), p.head<3>()};
}

const char* nameOf(statics::InverseStatus status) {
  if (status == statics::InverseStatus::kReached) return "reached";
  return status == statics::InverseStatus::kUnreachable ? "unreachable" : "not_converged";
}

// The results of all rows.
struct Found {
  explicit Found(const Scene& scene, std::size_t rows)
      : inputs(static_cast<Eigen::Index>(rows), scene.arm().actuatorCount()),
        limits(static_cast<Eigen::Index>(rows), scene.arm().actuatorCount()),
        residual(rows),
        position_error(rows),
        status(rows),
        iterations(rows) {}

  void set(std::size_t row, const InverseResult& result) {
    const auto i = static_cast<Eigen::Index>(row);
    inputs.row(i) = result.input;
    for (Eigen::Index j = 0; j < limits.cols(); ++j) {
      const statics::Limit limit = result.limits[static_cast<std::size_t>(j)];
      limits(i, j) = limit == statics::Limit::kNone ? 0 : limit == statics::Limit::kLower ? -1 : 1;
    }
    residual[row] = result.residual;
    position_error[row] = result.position_error;
    status[row] = result.status;
    iterations[row] = result.iterations;
  }

  template <class Number>
  using Table = Eigen::Matrix<Number, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  Table<double> inputs;
  Table<std::int8_t> limits;
  std::vector<double> residual, position_error;
  std::vector<statics::InverseStatus> status;
  std::vector<int> iterations;
};

template <class Number>
py::array tableOf(const Found::Table<Number>& table, bool single) {
  const py::array_t<Number> out = copyOf(table.data(), {table.rows(), table.cols()});
  if (single) return out.attr("reshape")(-1).template cast<py::array>();
  return out;
}

template <class Value>
py::object columnOf(const std::vector<Value>& values, bool single) {
  if (single) return py::cast(values.front());
  return copyOf(values.data(), {static_cast<py::ssize_t>(values.size())});
}

py::dict resultOf(const Found& found, bool single) {
  py::list status;
  std::vector<bool> reached;
  for (const statics::InverseStatus one : found.status) {
    status.append(nameOf(one));
    reached.push_back(one == statics::InverseStatus::kReached);
  }
  py::array_t<bool> reached_array(static_cast<py::ssize_t>(reached.size()));
  std::copy(reached.begin(), reached.end(), reached_array.mutable_data());
  py::dict out;
  out["pressures_pa"] = tableOf(found.inputs, single);
  out["reached"] = single ? py::object(py::bool_(reached[0])) : reached_array;
  out["status"] = single ? py::object(status[0]) : textsOf(status);
  out["residual_m"] = columnOf(found.residual, single);
  out["position_error_m"] = columnOf(found.position_error, single);
  out["limits"] = tableOf(found.limits, single);
  out["iterations"] = columnOf(found.iterations, single);
  return out;
}

struct Targets {
  Target kind;
  Rows rows;
};

Targets targetsOf(const Scene& scene, const py::object& tip, const py::object& pose,
                  const py::object& twists) {
  const int given = !tip.is_none() + !pose.is_none() + !twists.is_none();
  basics::require(given == 1, "inverse() got ", given,
                  " targets; expected exactly one of tip, pose and twists");
  if (!tip.is_none()) return {Target::kTip, Rows(tip, "tip", 3)};
  if (!pose.is_none()) return {Target::kPose, Rows(pose, "pose", 7)};
  const py::ssize_t sections = scene.arm().sectionCount();
  const py::array array = arrayOf(twists, "twists");
  const bool fits = (array.ndim() == 2 || array.ndim() == 3) &&
                    array.shape(array.ndim() - 1) == 6 && array.shape(array.ndim() - 2) == sections;
  if (!fits) {
    std::ostringstream message;
    message << "twists has shape " << shapeText(array) << "; expected (" << sections
            << ", 6) or (N, " << sections << ", 6)";
    throw py::value_error(message.str());
  }
  py::tuple shape = array.ndim() == 2 ? py::make_tuple(6 * sections)
                                      : py::make_tuple(array.shape(0), 6 * sections);
  return {Target::kTwists, Rows(array.attr("reshape")(shape), "twists", 6 * sections)};
}

py::dict inverse(const Scene& scene, const py::object& tip, const py::object& pose,
                 const py::object& twists, const py::object& start, const py::object& prefer,
                 const py::object& cocontraction, const py::object& position_tolerance,
                 const py::object& threads) {
  const Targets targets = targetsOf(scene, tip, pose, twists);
  const auto count = static_cast<std::size_t>(targets.rows.rows());
  targets.rows.numbersOf(scene.arm().actuatorCount());
  Found found(scene, count);  // first, as rows may be more than the memory holds
  InverseOptions options;
  options.preference = statics::preferenceOf(textOf(prefer, "prefer"));
  options.cocontraction = numberOf(cocontraction, "cocontraction");
  options.position_tolerance = numberOf(position_tolerance, "position_tolerance_m");
  const std::size_t thread_count = threadCount(threads);

  const model::Arm& arm = scene.arm();
  std::optional<Rows> starts;
  if (!start.is_none()) {
    starts.emplace(scene.inputs(start, "start"));
    basics::require(starts->rows() == 1 || starts->rows() == targets.rows.rows(), "start has ",
                    starts->rows(), " rows; expected one, or as many as ", targets.rows.name(),
                    ": ", targets.rows.rows());
    scene.requireWithinLimits(*starts);
  }
  const Eigen::VectorXd usual =
      arm.inputAt(options.preference == Preference::kCocontraction ? options.cocontraction : 0.0);

  requireFinite(targets.rows);
  {
    const OthersRun others_run;
    scene.solvers().take(options);  // checks them, also without rows
    const std::size_t piece = scene.isLoaded() ? kLoadedPiece : kPiece;
    inPieces(count, piece, thread_count, [&](std::size_t first, std::size_t end) {
      const Solvers::Loan loan = scene.solvers().take(options);
      InverseSolver& solver = loan.solver();
      Eigen::VectorXd from = usual;
      for (std::size_t i = first; i < end; ++i) {
        const auto row = static_cast<py::ssize_t>(i);
        const Eigen::VectorXd target = targets.rows.row(row);
        if (!target.allFinite()) targets.rows.refuseChange();
        if (starts) scene.copyRow(*starts, starts->rows() == 1 ? 0 : row, &from);
        switch (targets.kind) {
          case Target::kTip:
            found.set(i, solver.toPosition(target, from));
            break;
          case Target::kPose:
            found.set(i, solver.toPose(poseOf(target, row), from));
            break;
          case Target::kTwists:
            found.set(i, solver.toTwists(target.reshaped(6, arm.sectionCount()), from));
            break;
        }
      }
    });
  }
  return resultOf(found, targets.rows.single());
}

}  // namespace

void bindInverse(py::class_<Scene>& scene) {
  scene.def("_inverse", inverse, py::arg("tip"), py::arg("pose"), py::arg("twists"),
            py::arg("start"), py::arg("prefer"), py::arg("cocontraction"),
            py::arg("position_tolerance_m"), py::arg("threads"));
}

}  // namespace helix_arm::python
