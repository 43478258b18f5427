#include "helix_arm/statics/workspace.hpp"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

#include "bindings.hpp"

namespace helix_arm::python {
namespace {

constexpr std::int64_t kMostPoints = 100'000'000;
constexpr std::int64_t kMostSeed = std::numeric_limits<std::int64_t>::max();

// The points of all pieces, in their order.
statics::WorkspacePoints sample(const statics::Workspace& workspace, bool sensitivity,
                                std::size_t count, std::size_t threads) {
  const auto size = static_cast<std::size_t>(workspace.pieceSize());
  std::vector<statics::WorkspacePoints> pieces((count + size - 1) / size);
  inPieces(pieces.size(), 1, threads, [&](std::size_t first, std::size_t end) {
    for (std::size_t i = first; i < end; ++i) {
      pieces[i] = workspace.sample(i * size, static_cast<int>(std::min(size, count - i * size)));
    }
  });
  statics::WorkspacePoints all;
  Eigen::Index kept = 0;
  for (const statics::WorkspacePoints& piece : pieces) kept += piece.count();
  all.inputs.resize(kept, workspace.model().arm().actuatorCount());
  all.tips.resize(kept, 3);
  all.sensitivity.resize(sensitivity ? kept : 0, statics::kSensitivities);
  Eigen::Index row = 0;
  for (statics::WorkspacePoints& piece : pieces) {
    all.inputs.middleRows(row, piece.count()) = piece.inputs;
    all.tips.middleRows(row, piece.count()) = piece.tips;
    if (sensitivity) all.sensitivity.middleRows(row, piece.count()) = piece.sensitivity;
    all.unbalanced += piece.unbalanced;
    row += piece.count();
    piece = {};
  }
  return all;
}

py::dict workspace(const Scene& scene, const py::handle& point_count, const py::handle& seed,
                   const py::handle& with_sensitivity, const py::handle& with_extremes,
                   const py::handle& threads) {
  const std::int64_t points = integerOf(point_count, "points", 0, kMostPoints);
  const auto first_seed = static_cast<std::uint64_t>(integerOf(seed, "seed", 0, kMostSeed));
  const bool sensitivity = flagOf(with_sensitivity, "sensitivity");
  const bool extremes = flagOf(with_extremes, "extremes");
  const std::size_t thread_count = threadCount(threads);
  const py::ssize_t n = scene.arm().actuatorCount();
  statics::WorkspacePoints all;
  std::optional<statics::WorkspaceExtremes> farthest;
  {
    const OthersRun others_run;
    all = sample(statics::Workspace(scene.model(), {first_seed, sensitivity}), sensitivity,
                 static_cast<std::size_t>(points), thread_count);
    if (extremes) {
      farthest.emplace();
      farthest->add(all);
      farthest = statics::findExtremes(scene.model(), *farthest);
    }
  }
  py::dict out;
  out["pressures_pa"] = matrixOf(all.inputs);
  out["tips"] = matrixOf(all.tips);
  out["unbalanced"] = all.unbalanced;
  const auto column = [&](int i) -> py::object {
    if (!sensitivity) return py::none();
    return vectorOf(all.sensitivity.col(i));
  };
  out["moved_per_kpa_m"] = column(0);
  out["moved_per_mm_m"] = column(1);
  out["moved_per_percent_stiffness_m"] = column(2);
  out["extreme_pressures_pa"] = py::none();
  out["extreme_tips"] = py::none();
  out["extreme_bounds_m"] = py::none();
  if (farthest && !farthest->empty()) {
    Eigen::MatrixXd inputs(statics::WorkspaceExtremes::kCount, n), tips(inputs.rows(), 3);
    Eigen::VectorXd bounds(inputs.rows());
    for (int i = 0; i < statics::WorkspaceExtremes::kCount; ++i) {
      inputs.row(i) = farthest->of(i).input;
      tips.row(i) = farthest->of(i).tip;
      bounds[i] = farthest->boundOf(i);
    }
    out["extreme_pressures_pa"] = matrixOf(inputs);
    out["extreme_tips"] = matrixOf(tips);
    out["extreme_bounds_m"] = vectorOf(bounds);
  }
  return out;
}

}  // namespace

void bindWorkspace(py::class_<Scene>& scene) {
  scene.def("_workspace", workspace, py::arg("points"), py::arg("seed"), py::arg("sensitivity"),
            py::arg("extremes"), py::arg("threads"));
}

}  // namespace helix_arm::python
