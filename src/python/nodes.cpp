#include <sstream>
#include <tuple>
#include <variant>

#include <pybind11/eigen.h>
#include <pybind11/stl.h>

#include "basics/quote.hpp"
#include "bindings.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/data_set.hpp"
#include "io/data/tip_path_file.hpp"
#include "io/document/atomic_file.hpp"
#include "io/document/number.hpp"
#include "io/scene/shipped_files.hpp"
#include "procedures/pressure_plan.hpp"

namespace helix_arm::python {
namespace {

// Rows of pressures (rows x actuators) [Pa]; the actuators that have no column; and which rows are
// no valid target, empty if all are.
std::tuple<Eigen::MatrixXd, std::vector<std::string>, std::string> seriesOf(
    const Scene& scene, const std::string& path) {
  const model::Arm& arm = scene.arm();
  const io::DataSet data = io::loadDataSet(path);
  Eigen::MatrixXd rows = io::pressuresOf(data, arm.actuatorCount());
  std::vector<std::string> without;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const std::string column = "pressure_" + std::to_string(i + 1) + "_kpa";
    if (data.find(column) < 0) without.push_back(arm.actuator(i).name);
  }
  std::ostringstream faults;
  for (int row = 0; row < rows.rows(); ++row) {
    const Eigen::VectorXd wanted = rows.row(row);
    const auto checked = control::checkPressures(arm, Eigen::VectorXd::Zero(wanted.size()), {},
                                                 {wanted.begin(), wanted.end()});
    if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
      faults << path << " row " << row + 1 << ": " << refusal->message << "\n";
    }
  }
  return {rows, without, faults.str()};
}

// (points, 4): time [s], x, y, z [m].
Eigen::MatrixXd tipPathOf(const std::string& path) {
  const auto points = io::loadTipPath(io::loadDataSet(path));
  Eigen::MatrixXd out(points.size(), 4);
  for (std::size_t k = 0; k < points.size(); ++k) {
    out.row(static_cast<Eigen::Index>(k)) << points[k].time, points[k].position.transpose();
  }
  return out;
}

}  // namespace

void bindNodes(py::module_& module, py::class_<Scene>& scene) {
  scene.def("_series", &seriesOf)
      .def("_tour", [](const Scene& self) { return procedures::pressureTour(self.arm()); })
      .def_property_readonly("_has_vision", [](const Scene& self) { return self.scene().isSeen(); })
      .def_property_readonly("_has_bodies",
                             [](const Scene& self) { return self.scene().hasBodies(); })
      .def("_require_same_rig", [](const Scene& self, const Scene& next) {
        io::requireSameRig(self.scene(), next.scene());
      });
  module.def("_tip_path", &tipPathOf);
  module.def("_shipped", [](const std::string& folder, const std::string& extension) {
    return std::pair(io::shippedFolder(folder), io::shippedNames(folder, extension));
  });
  module.def("_format", &io::formatNumber);
  module.def("_printable", [](const std::string& text) { return basics::printableLines(text); });
  module.def("_write", [](const std::string& path, const py::bytes& content) {
    io::writeFileAtomically(path, content);
  });
}

}  // namespace helix_arm::python
