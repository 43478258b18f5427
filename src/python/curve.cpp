#include "bindings.hpp"
#include "parallel.hpp"
#include "poses.hpp"

namespace helix_arm::python {
namespace {

constexpr int kMostPoints = 100000;
constexpr std::size_t kPiece = 64;
constexpr std::size_t kLoadedPiece = 8;

py::dict curve(const Scene& scene, const py::handle& pressures, const py::handle& point_count,
               const py::handle& threads) {
  const Rows inputs = scene.inputs(pressures, "pressures_pa");
  const auto points = static_cast<int>(integerOf(point_count, "points", 2, kMostPoints));
  const std::size_t thread_count = threadCount(threads);
  py::array_t<double> places(points);
  py::array_t<double> positions(inputs.shapeOf({points, 3}));
  py::array_t<double> quaternions(inputs.shapeOf({points, 4}));
  for (int i = 0; i < points; ++i) {
    places.mutable_at(i) = static_cast<double>(scene.arm().sectionCount()) * i / (points - 1);
  }
  double* const position = positions.mutable_data();
  double* const quaternion = quaternions.mutable_data();
  const auto rows = static_cast<std::size_t>(inputs.rows());
  const auto count = static_cast<std::size_t>(points);
  {
    const OthersRun others_run;
    scene.requireWithinLimits(inputs);  // with the memory at hand: rows may be many
    inPieces(rows, scene.isLoaded() ? kLoadedPiece : kPiece, thread_count,
             [&](std::size_t first, std::size_t end) {
               Eigen::VectorXd q;
               for (std::size_t row = first; row < end; ++row) {
                 scene.copyRow(inputs, static_cast<py::ssize_t>(row), &q);
                 const bool found = !scene.isLoaded() || scene.model().tip(q).converged();
                 const auto curve = scene.model().curve(q, points);
                 for (std::size_t i = 0; i < count; ++i) {
                   const std::size_t at = row * count + i;
                   setPose(curve[i].X, found, position + 3 * at, quaternion + 4 * at);
                 }
               }
             });
  }
  py::dict out;
  out["s"] = places;
  out["positions"] = positions;
  out["quaternions_xyzw"] = quaternions;
  return out;
}

}  // namespace

void bindCurve(py::class_<Scene>& scene) {
  scene.def("_curve", curve, py::arg("pressures_pa"), py::arg("points"), py::arg("threads"));
}

}  // namespace helix_arm::python
