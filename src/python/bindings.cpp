#include "bindings.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <utility>

#include <pybind11/stl.h>

#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/lie/so3.hpp"
#include "io/scene/shipped_files.hpp"

namespace helix_arm::python {
namespace {

constexpr std::size_t kMostKept = 64;

// Compares the options that callers can choose.
bool same(const statics::InverseOptions& a, const statics::InverseOptions& b) {
  return a.preference == b.preference && a.cocontraction == b.cocontraction &&
         a.position_tolerance == b.position_tolerance;
}

using Pairs = std::vector<std::pair<std::string, std::string>>;

py::array_t<double> limitsOf(const Scene& scene) {
  py::array_t<double> out({scene.arm().actuatorCount(), 2});
  for (int i = 0; i < scene.arm().actuatorCount(); ++i) {
    out.mutable_at(i, 0) = scene.arm().actuator(i).limits.lower;
    out.mutable_at(i, 1) = scene.arm().actuator(i).limits.upper;
  }
  return out;
}

void translateExceptions(py::module_& module) {
  // Never freed: the interpreter may be gone by then.
  static auto& document_error =
      *new py::exception<io::DocumentError>(module, "DocumentError", PyExc_ValueError);
  document_error.attr("__doc__") =
      "A file that breaks its rules, or cannot be read; one fault per line: file:line key value "
      "rule.";
  py::register_exception_translator([](std::exception_ptr exception) {
    try {
      if (exception) std::rethrow_exception(exception);
    } catch (const io::DocumentError& error) {
      PyErr_SetString(document_error.ptr(), error.what());
    } catch (const std::out_of_range& error) {
      PyErr_SetString(PyExc_ValueError, error.what());
    }
  });
}

void bindScene(py::class_<Scene>& scene) {
  scene
      .def(py::init([](const std::string& path, const Pairs& overrides) {
             std::vector<io::Override> values;
             for (const auto& [key, value] : overrides) values.push_back({key, value});
             const OthersRun others_run;
             return std::make_unique<Scene>(path, values);
           }),
           "path"_a, "overrides"_a)
      .def_property_readonly("path", &Scene::path, "File of the scene.")
      .def_property_readonly("_overrides",
                             [](const Scene& self) {
                               Pairs out;
                               for (const io::Override& one : self.overrides()) {
                                 out.emplace_back(one.key, one.value);
                               }
                               return out;
                             })
      .def_property_readonly("_picture_shape",
                             [](const Scene& self) -> std::optional<std::pair<int, int>> {
                               const auto& camera = self.scene().camera;
                               if (!camera || !self.scene().tags) return std::nullopt;
                               return std::pair(camera->model.height, camera->model.width);
                             })
      .def_property_readonly(
          "name", [](const Scene& self) { return self.scene().name; }, "Name of the scene.")
      .def_property_readonly(
          "actuators", [](const Scene& self) { return self.arm().actuatorNames(); },
          "Names of the n actuators, in the order of all rows of pressures.")
      .def_property_readonly(
          "sections", [](const Scene& self) { return self.arm().sectionCount(); },
          "Number of sections.")
      .def_property_readonly(
          "limits_pa", limitsOf,
          "(n, 2) lower and upper limit of each pressure [Pa]; of a tendon its angle [rad].")
      .def_property_readonly(
          "length_m", [](const Scene& self) { return self.arm().restLength(); },
          "Length of the base curve at rest [m].")
      .def_property_readonly(
          "tier", [](const Scene& self) { return self.model().choice().setting.name(); },
          "Tier that computes the shapes.");
}

}  // namespace

py::array argumentArray(const py::handle& given, const char* name) {
  if (py::isinstance<py::array_t<double>>(given)) return py::reinterpret_borrow<py::array>(given);
  const py::array any = py::array::ensure(given);
  PyErr_Clear();  // of lists that are no table
  // From text, numpy would parse numbers.
  if (!any || std::string("fiu").find(any.dtype().kind()) == std::string::npos) {
    throw py::type_error(std::string(name) + " is " + std::string(py::repr(given)).substr(0, 60) +
                         "; expected a numpy array of float64, or equally long rows of numbers");
  }
  return py::array_t<double, py::array::forcecast>(any);
}

Rows::Rows(const py::handle& given, const char* name, py::ssize_t columns)
    : name_(name), array_(argumentArray(given, name)), columns_(columns) {
  const py::ssize_t dimensions = array_.ndim();
  if (dimensions < 1 || dimensions > 2 || array_.shape(dimensions - 1) != columns) {
    throw py::value_error(name_ + " has shape " + std::string(py::str(array_.attr("shape"))) +
                          "; expected (" + std::to_string(columns) + ",) or (N, " +
                          std::to_string(columns) + ")");
  }
  single_ = dimensions == 1;
  data_ = static_cast<const char*>(array_.data());
  rows_ = single_ ? 1 : array_.shape(0);
  row_stride_ = single_ ? 0 : array_.strides(0);
  column_stride_ = array_.strides(dimensions - 1);
}

Eigen::VectorXd Rows::row(py::ssize_t row) const {
  Eigen::VectorXd out(columns_);
  for (py::ssize_t j = 0; j < columns_; ++j) out[j] = (*this)(row, j);
  return out;
}

std::vector<py::ssize_t> Rows::shapeOf(const std::vector<py::ssize_t>& entry) const {
  std::vector<py::ssize_t> shape;
  if (!single_) shape.push_back(rows_);
  shape.insert(shape.end(), entry.begin(), entry.end());
  return shape;
}

void Rows::requireFinite() const {
  for (py::ssize_t i = 0; i < rows_; ++i) {
    for (py::ssize_t j = 0; j < columns_; ++j) {
      const double number = (*this)(i, j);
      if (std::isfinite(number)) continue;
      std::ostringstream message;
      message << name_ << " holds " << number << " in row " << i << ", column " << j
              << "; expected finite numbers";
      throw py::value_error(message.str());
    }
  }
}

void setPose(const lie::SE3& pose, bool found, double* position, double* quaternion) {
  constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
  Eigen::Vector3d::Map(position) = found ? pose.translation : Eigen::Vector3d::Constant(kNoNumber);
  Eigen::Vector4d::Map(quaternion) =
      found ? lie::quaternionXyzw(pose.rotation) : Eigen::Vector4d::Constant(kNoNumber);
}

Solvers::Solvers(const statics::ArmModel& model) : model_(model) {
  kept_.reserve(kMostKept);  // giving back does not allocate
}

Solvers::Loan Solvers::take(const statics::InverseOptions& options) {
  const auto give_back = [this, options](statics::InverseSolver* solver) {
    giveBack(options, std::unique_ptr<statics::InverseSolver>(solver));
  };
  Loan loan(nullptr, give_back);
  {
    const basics::MutexLock lock(mutex_);
    const auto found = std::find_if(kept_.rbegin(), kept_.rend(), [&options](const Kept& one) {
      return same(one.options, options);
    });
    if (found != kept_.rend()) {
      loan.reset(found->solver.release());
      kept_.erase(std::prev(found.base()));
      return loan;
    }
  }
  loan.reset(new statics::InverseSolver(model_, options));
  return loan;
}

void Solvers::giveBack(const statics::InverseOptions& options,
                       std::unique_ptr<statics::InverseSolver> solver) noexcept {
  std::unique_ptr<statics::InverseSolver> oldest;  // ends without the lock
  const basics::MutexLock lock(mutex_);
  if (kept_.size() == kMostKept) {
    oldest = std::move(kept_.front().solver);
    kept_.erase(kept_.begin());
  }
  kept_.push_back({options, std::move(solver)});
}

Scene::Scene(const std::string& path, const std::vector<io::Override>& overrides)
    : path_(path),
      overrides_(overrides),
      scene_(io::loadScene(path, overrides_)),
      solvers_(scene_.model) {}

Rows Scene::inputs(const py::handle& given, const char* name) const {
  constexpr py::ssize_t kJudged = 64;  // rows that are judged for kPa: all would take long
  Rows inputs(given, name, arm().actuatorCount());
  for (py::ssize_t i = 0; i < inputs.columns() && inputs.rows() > 0; ++i) {
    if (inputs(0, i) >= control::UnitWatch::kSuspicious) return inputs;
  }
  const py::ssize_t judged = std::min(inputs.rows(), kJudged);
  Eigen::MatrixXd sample(judged, inputs.columns());
  for (py::ssize_t k = 0; k < judged; ++k) {
    sample.row(k) = inputs.row(judged > 1 ? k * (inputs.rows() - 1) / (judged - 1) : 0);
  }
  const std::string warning = control::kilopascalWarning(name, arm(), sample);
  if (!warning.empty() && PyErr_WarnEx(PyExc_UserWarning, warning.c_str(), 2) != 0) {
    throw py::error_already_set();
  }
  return inputs;
}

void Scene::copyRow(const Rows& inputs, py::ssize_t row, Eigen::VectorXd* q) const {
  q->resize(inputs.columns());
  for (int i = 0; i < arm().actuatorCount(); ++i) {
    const model::Actuator& actuator = arm().actuator(i);
    const model::Range limits = actuator.limits;
    const double input = (*q)[i] = inputs(row, i);
    if (limits.contains(input)) continue;
    const model::DriveUnit unit = model::unitOf(actuator.drive);
    std::ostringstream message;
    message.precision(12);
    message << inputs.name() << " asks " << actuator.name << " for " << input << " " << unit.si;
    if (!inputs.single()) message << " in row " << row;
    message << "; its limits are " << limits.lower << " to " << limits.upper << " " << unit.si
            << (unit.pressure ? " (gauge)" : "");
    throw std::invalid_argument(message.str());
  }
}

PYBIND11_MODULE(_core, module) {
  module.doc() = "The model of helix_arm in C++; use the package helix_arm.";
  translateExceptions(module);
  py::class_<Scene> scene(module, "Scene");
  bindScene(scene);
  bindModel(scene);
  bindDynamics(module, scene);
  bindMeasurements(scene);
  bindRecordings(module, scene);
  bindExperiments(module, scene);
  bindNodes(module, scene);
  module.attr("version") = HELIX_ARM_VERSION;
  module.def(
      "shipped_scenes", [] { return io::shippedNames(io::kShippedScenes); },
      "Names of the shipped scenes.");
  module.def("scene_path", &io::scenePath, "path_or_name"_a,
             "Path of a scene file, or of a shipped scene by name.");
  module.def("array", &argumentArray, "given"_a, "name"_a, "The float64 array of an argument.");
  module.def(
      "rows",
      [](const py::handle& given, const char* name, py::ssize_t columns) {
        return Rows(given, name, columns).array();
      },
      "given"_a, "name"_a, "columns"_a,
      "The float64 array of an argument with one row or several.");
  module.def(
      "require_finite",
      [](const py::array& rows, const char* name) {
        Rows(rows, name, rows.shape(rows.ndim() - 1)).requireFinite();
      },
      "rows"_a, "name"_a, "Raises ValueError naming the entry that is not finite.");
}

}  // namespace helix_arm::python
