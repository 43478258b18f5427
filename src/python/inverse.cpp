#include "helix_arm/statics/inverse.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <optional>

#include "bindings.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::python {
namespace {

using statics::InverseResult;

constexpr Piece kInversePiece{256, 16};
constexpr double kNormTolerance = 1e-3;  // more than the rounding of a few digits

lie::SE3 poseOf(const Eigen::VectorXd& p, std::size_t row) {
  const Eigen::Quaterniond q(p[6], p[3], p[4], p[5]);
  basics::require(std::abs(q.norm() - 1) <= kNormTolerance, "pose has a quaternion of norm ",
                  q.norm(), " in row ", row, "; expected 1, in the order x, y, z, qx, qy, qz, qw");
  return {q.normalized().toRotationMatrix(), p.head<3>()};
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

  void set(std::size_t row, const InverseResult& result) const {
    Eigen::VectorXd::Map(inputs.at(row), inputs.size()) = result.input;
    std::transform(result.limits.begin(), result.limits.end(), limits.at(row),
                   [](statics::Limit limit) -> std::int8_t {
                     if (limit == statics::Limit::kNone) return 0;
                     return limit == statics::Limit::kLower ? -1 : 1;
                   });
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
    scene.requireWithinLimits(*starts);
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
        if (!target.allFinite()) targets.refuseChange();
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
                  "limits"_a = found.limits.result(), "iterations"_a = found.iterations.result());
}

}  // namespace

void bindInverse(py::class_<Scene>& scene) {
  scene.def("_inverse", inverse, py::arg("kind"), py::arg("wanted"), py::arg("start"),
            py::arg("prefer"), py::arg("cocontraction"), py::arg("position_tolerance_m"),
            py::arg("threads"));
}

}  // namespace helix_arm::python
