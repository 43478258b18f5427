#include "helix_arm/statics/jacobian.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <string>

#include "arrays.hpp"
#include "bindings.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/basics/text.hpp"

namespace helix_arm::python {
namespace {

constexpr std::size_t kPiece = 16;
constexpr std::size_t kLoadedPiece = 1;

using Table = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// The two arrays of one derivative, per row.
struct Arrays {
  Arrays(const Rows& inputs, int sections, const std::vector<py::ssize_t>& by) : columns(1) {
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

  py::ssize_t columns;
  py::array_t<double> tip, twists;
  double *tip_data, *twists_data;
};

enum By { kPressures, kLengths, kStiffness, kLoad };
constexpr std::array<const char*, 4> kByWords{"pressures", "lengths", "stiffness", "load"};
using Wanted = std::array<bool, kByWords.size()>;

Wanted wantedOf(const py::list& by) {
  static const std::string words = basics::joined(kByWords);
  basics::require(!by.empty(), "by is empty; expected one or several of ", words);
  Wanted wanted{};
  for (std::size_t i = 0; i < by.size(); ++i) {
    const std::string word = textOf(by[i], ("by[" + std::to_string(i) + "]").c_str());
    const auto found = std::find(kByWords.begin(), kByWords.end(), word);
    basics::require(found != kByWords.end(), "by holds \"", basics::quoted(word),
                    "\"; expected one or several of ", words);
    wanted[static_cast<std::size_t>(found - kByWords.begin())] = true;
  }
  return wanted;
}

// Of the derivatives that are wanted.
struct AllArrays {
  AllArrays(const Scene& scene, const Rows& inputs, Wanted wanted) {
    wanted[kLoad] = wanted[kLoad] && scene.model().load();
    const int sections = scene.arm().sectionCount();
    const py::ssize_t n = scene.arm().actuatorCount();
    const std::array<std::vector<py::ssize_t>, kByWords.size()> columns{{{n}, {n}, {n, 3}, {6}}};
    for (std::size_t i = 0; i < by.size(); ++i) {
      if (wanted[i]) by[i].emplace(inputs, sections, columns[i]);
    }
  }
  statics::JacobianParts parts() const {
    return {by[kStiffness].has_value(), by[kLoad].has_value()};
  }
  void set(std::size_t row, const statics::ShapeJacobian& found) {
    if (by[kPressures]) by[kPressures]->set(row, found.by_inputs);
    if (by[kLengths]) by[kLengths]->set(row, found.by_lengths);
    if (by[kStiffness]) by[kStiffness]->set(row, *found.by_stiffness);
    if (by[kLoad]) by[kLoad]->set(row, *found.by_load);
  }
  py::dict fields() const {
    py::dict out;
    for (std::size_t i = 0; i < by.size(); ++i) {
      const std::string ending = std::string("_by_") + kByWords[i];
      out[("tip" + ending).c_str()] = by[i] ? py::object(by[i]->tip) : py::none();
      out[("twists" + ending).c_str()] = by[i] ? py::object(by[i]->twists) : py::none();
    }
    return out;
  }

  std::array<std::optional<Arrays>, kByWords.size()> by;
};

py::dict jacobian(const Scene& scene, const py::handle& pressures, const py::list& by,
                  const py::handle& threads) {
  const Rows inputs = scene.inputs(pressures, "pressures_pa");
  const Wanted wanted = wantedOf(by);
  const std::size_t thread_count = threadCount(threads);
  AllArrays arrays(scene, inputs, wanted);
  const statics::JacobianParts parts = arrays.parts();
  const auto rows = static_cast<std::size_t>(inputs.rows());
  std::unique_ptr<bool[]> converged(new bool[rows]);
  {
    const OthersRun others_run;
    scene.requireWithinLimits(inputs);  // with the memory at hand: rows may be many
    inPieces(rows, scene.isLoaded() ? kLoadedPiece : kPiece, thread_count,
             [&](std::size_t first, std::size_t end) {
               Eigen::VectorXd q;
               for (std::size_t row = first; row < end; ++row) {
                 scene.copyRow(inputs, static_cast<py::ssize_t>(row), &q);
                 const statics::ShapeJacobian found = statics::jacobianAt(scene.model(), q, parts);
                 converged[row] = found.status == statics::SolveStatus::kConverged;
                 arrays.set(row, found);
               }
             });
  }
  py::dict out = arrays.fields();
  out["converged"] = inputs.single() ? py::object(py::bool_(converged[0]))
                                     : copyOf(converged.get(), {static_cast<py::ssize_t>(rows)});
  return out;
}

}  // namespace

void bindJacobian(py::class_<Scene>& scene) {
  scene.def("_jacobian", jacobian, py::arg("pressures_pa"), py::arg("by"), py::arg("threads"));
}

}  // namespace helix_arm::python
