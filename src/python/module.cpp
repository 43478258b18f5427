#include <pybind11/stl.h>

#include "bindings.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/shipped_files.hpp"

namespace helix_arm::python {
namespace {

using Pairs = std::vector<std::pair<std::string, std::string>>;

std::vector<std::string> actuatorNames(const Scene& scene) {
  std::vector<std::string> names;
  for (int i = 0; i < scene.arm().actuatorCount(); ++i)
    names.push_back(scene.arm().actuator(i).name);
  return names;
}

py::array_t<double> limitsOf(const Scene& scene) {
  py::array_t<double> out({scene.arm().actuatorCount(), 2});
  for (int i = 0; i < scene.arm().actuatorCount(); ++i) {
    out.mutable_at(i, 0) = scene.arm().actuator(i).limits.lower;
    out.mutable_at(i, 1) = scene.arm().actuator(i).limits.upper;
  }
  return out;
}

// At the first use of an object that no __init__() made, pybind11 asks for memory, which it would
// take for the value.
void refuseUnmade(py::module_& module) {
  for (const auto& [name, bound] : py::dict(module.attr("__dict__"))) {
    if (!PyType_Check(bound.ptr())) continue;
    auto* const type = py::detail::get_type_info(reinterpret_cast<PyTypeObject*>(bound.ptr()));
    if (type == nullptr) continue;
    type->operator_new = [](std::size_t) -> void* {
      throw py::type_error(
          "the object is of __new__() alone, without __init__(); expected one of Scene.load(), or "
          "of a method of such a scene");
    };
  }
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
      document_error(error.what());
    } catch (const TooManyRows& error) {
      PyErr_SetString(PyExc_MemoryError, error.what());
    } catch (const std::bad_alloc&) {
      PyErr_SetString(
          PyExc_MemoryError,
          "the rows and their results need more memory than there is; pass fewer rows at a time");
    } catch (const std::out_of_range& error) {
      PyErr_SetString(PyExc_ValueError, error.what());
    }
  });
}

}  // namespace

PYBIND11_MODULE(_core, module) {
  module.doc() = "The model of helix_arm in C++; use the package helix_arm.";
  translateExceptions(module);
  py::class_<Scene> scene(module, "Scene");
  scene
      .def(py::init([](const std::string& path, const Pairs& overrides) {
             std::vector<io::Override> values;
             for (const auto& [key, value] : overrides) values.push_back({key, value});
             const OthersRun others_run;
             return std::make_unique<Scene>(path, values);
           }),
           py::arg("path"), py::arg("overrides"))
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
      .def_property_readonly("_solvers_made",
                             [](const Scene& self) { return self.solvers().made(); })
      .def_property_readonly(
          "name", [](const Scene& self) { return self.scene().name; }, "Name of the scene.")
      .def_property_readonly("actuators", actuatorNames,
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
  bindModel(module, scene);
  bindInverse(scene);
  bindMeasurements(scene);
  refuseUnmade(module);
  module.attr("version") = HELIX_ARM_VERSION;
  module.def(
      "shipped_scenes", [] { return io::shippedNames(io::kShippedScenes); },
      "Names of the shipped scenes.");
  module.def("scene_path", &io::scenePath, py::arg("path_or_name"),
             "Path of a scene file, or of a shipped scene by name.");
  module.def("array", &argumentArray, py::arg("given"), py::arg("name"),
             "The float64 array of an argument.");
  module.def(
      "rows",
      [](const py::handle& given, const char* name, py::ssize_t columns) {
        return Rows(given, name, columns).array();
      },
      py::arg("given"), py::arg("name"), py::arg("columns"),
      "The float64 array of an argument with one row or several.");
  module.def(
      "require_finite",
      [](const py::array& rows, const char* name) {
        Rows(rows, name, rows.shape(rows.ndim() - 1)).requireFinite();
      },
      py::arg("rows"), py::arg("name"), "Raises ValueError naming the entry that is not finite.");
}

}  // namespace helix_arm::python
