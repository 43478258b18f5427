#include "helix_arm/statics/jacobian.hpp"

#include <limits>
#include <string>

#include "bindings.hpp"
#include "parallel.hpp"
#include "poses.hpp"

namespace helix_arm::python {
namespace {

constexpr std::size_t kPiece = 16;
constexpr std::size_t kLoadedPiece = 1;

using Table = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// The two arrays of one derivative, per row.
struct Arrays {
  Arrays(const Rows& inputs, int sections, std::initializer_list<py::ssize_t> by) : columns(1) {
    for (const py::ssize_t size : by) columns *= size;
    std::vector<py::ssize_t> entry{sections, 6};
    entry.insert(entry.end(), by.begin(), by.end());
    twists = py::array_t<double>(inputs.shapeOf(entry));
    entry.erase(entry.begin());
    tip = py::array_t<double>(inputs.shapeOf(entry));
    tip_data = tip.mutable_data();
    twists_data = twists.mutable_data();
  }
  void set(std::size_t row, const statics::ShapeDerivative& derivative) {
    const auto at = static_cast<py::ssize_t>(row) * columns;
    const Eigen::Index rows = derivative.twists.rows();
    Table::Map(tip_data + 6 * at, 6, columns) = derivative.tip;
    Table::Map(twists_data + rows * at, rows, columns) = derivative.twists;
  }
  void addTo(py::dict& out, const std::string& by) const {
    out[("tip_by_" + by).c_str()] = tip;
    out[("twists_by_" + by).c_str()] = twists;
  }

  py::ssize_t columns;
  py::array_t<double> tip, twists;
  double *tip_data, *twists_data;
};

py::dict jacobian(const Scene& scene, const py::handle& pressures, const py::handle& threads) {
  const Rows inputs = scene.inputs(pressures, "pressures_pa");
  const std::size_t thread_count = threadCount(threads);
  const int sections = scene.arm().sectionCount();
  const py::ssize_t n = scene.arm().actuatorCount();
  Arrays by_pressures(inputs, sections, {n}), by_lengths(inputs, sections, {n}),
      by_stiffness(inputs, sections, {n, 3}), by_load(inputs, sections, {6});
  const bool has_load = scene.model().load().has_value();
  const auto rows = static_cast<std::size_t>(inputs.rows());
  std::unique_ptr<bool[]> converged(new bool[rows]);
  {
    const py::gil_scoped_release others_run;
    scene.requireWithinLimits(inputs);  // with the memory at hand: rows may be many
    inPieces(rows, scene.isLoaded() ? kLoadedPiece : kPiece, thread_count,
             [&](std::size_t first, std::size_t end) {
               Eigen::VectorXd q;
               for (std::size_t row = first; row < end; ++row) {
                 scene.copyRow(inputs, static_cast<py::ssize_t>(row), &q);
                 const statics::ShapeJacobian found = statics::jacobianAt(scene.model(), q);
                 converged[row] = found.status == statics::SolveStatus::kConverged;
                 by_pressures.set(row, found.by_inputs);
                 by_lengths.set(row, found.by_lengths);
                 by_stiffness.set(row, found.by_stiffness);
                 if (found.by_load) by_load.set(row, *found.by_load);
               }
             });
  }
  py::dict out;
  by_pressures.addTo(out, "pressures");
  by_lengths.addTo(out, "lengths");
  by_stiffness.addTo(out, "stiffness");
  out["tip_by_load"] = has_load ? py::object(by_load.tip) : py::none();
  out["twists_by_load"] = has_load ? py::object(by_load.twists) : py::none();
  out["converged"] = inputs.single()
                         ? py::object(py::bool_(converged[0]))
                         : py::array_t<bool>(static_cast<py::ssize_t>(rows), converged.get());
  return out;
}

}  // namespace

void bindJacobian(py::class_<Scene>& scene) {
  scene.def("_jacobian", jacobian, py::arg("pressures_pa"), py::arg("threads"));
}

}  // namespace helix_arm::python
