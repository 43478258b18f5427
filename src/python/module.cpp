#include <pybind11/stl.h>

#include "bindings.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/shipped_files.hpp"

namespace helix_arm::python {
namespace {

std::vector<std::string> actuatorNames(const Scene& scene) {
  std::vector<std::string> names;
  for (int i = 0; i < scene.arm().actuatorCount(); ++i)
    names.push_back(scene.arm().actuator(i).name);
  return names;
}

std::vector<std::pair<std::string, std::string>> overridesOf(const Scene& scene) {
  std::vector<std::pair<std::string, std::string>> out;
  for (const io::Override& one : scene.overrides()) out.emplace_back(one.key, one.value);
  return out;
}

py::array_t<double> limitsOf(const Scene& scene) {
  py::array_t<double> out({scene.arm().actuatorCount(), 2});
  for (int i = 0; i < scene.arm().actuatorCount(); ++i) {
    out.mutable_at(i, 0) = scene.arm().actuator(i).limits.lower;
    out.mutable_at(i, 1) = scene.arm().actuator(i).limits.upper;
  }
  return out;
}

}  // namespace

PYBIND11_MODULE(_core, module) {
  module.doc() = "The model of helix_arm in C++; use the package helix_arm.";
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
    } catch (const std::bad_alloc&) {
      PyErr_SetString(PyExc_MemoryError,
                      "the rows and their results need more memory than there is; pass fewer rows "
                      "at a time");
    } catch (const std::out_of_range& error) {
      PyErr_SetString(PyExc_ValueError, error.what());
    }
  });

  py::class_<Scene> scene(module, "Scene");
  scene
      .def(py::init([](const std::string& path,
                       const std::vector<std::pair<std::string, std::string>>& overrides) {
             const py::gil_scoped_release others_run;
             return std::make_unique<Scene>(path, overrides);
           }),
           py::arg("path"), py::arg("overrides"))
      .def_property_readonly("path", &Scene::path, "File of the scene.")
      .def_property_readonly("_overrides", overridesOf)
      .def_property_readonly(
          "name", [](const Scene& self) { return self.scene().name; }, "Name of the scene.")
      .def_property_readonly("actuators", actuatorNames,
                             "Names of the n actuators, in the order of all rows of pressures.")
      .def_property_readonly(
          "sections", [](const Scene& self) { return self.arm().sectionCount(); },
          "Number of sections.")
      .def_property_readonly("limits_pa", limitsOf,
                             "(n, 2) lower and upper limit of each pressure [Pa]; of a tendon its "
                             "angle [rad].")
      .def_property_readonly(
          "length_m", [](const Scene& self) { return self.arm().restLength(); },
          "Length of the base curve at rest [m].")
      .def_property_readonly(
          "tier", [](const Scene& self) { return self.model().choice().setting.name(); },
          "Tier that computes the shapes.");
  bindForward(module, scene);
  bindCurve(scene);
  bindInverse(scene);
  bindJacobian(scene);
  bindWorkspace(scene);
  bindCalibrate(scene);
  bindFit(scene);
  bindFollow(scene);
  bindLocalize(scene);
  module.attr("version") = HELIX_ARM_VERSION;
  module.def(
      "shipped_scenes", [] { return io::shippedNames(io::kShippedScenes); },
      "Names of the shipped scenes.");
  module.def("scene_path", &io::scenePath, "Path of a scene file, or of a shipped scene by name.");
}

}  // namespace helix_arm::python
