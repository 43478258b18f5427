#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "forward.hpp"
#include "helix_arm/model/batch.hpp"
#include "parallel.hpp"

namespace helix_arm::python {
namespace {

// Work of one thread at a time; a tip does not depend on the division.
constexpr std::size_t kPiece = 16384;
constexpr std::size_t kLoadedPiece = 16;

void closedForm(const Scene& scene, const model::TipBatch& batch, const Rows& inputs,
                std::size_t first, std::size_t end, double* out) {
  model::InputArray array{reinterpret_cast<const double*>(inputs.data()), inputs.rowStride(),
                          inputs.columnStride()};
  array.first = array.place(first, 0);
  const auto rows = static_cast<std::size_t>(inputs.rows());
  if (batch.rows(array, end - first, out + 3 * first, rows)) return;
  scene.requireWithinLimits(inputs);  // says where
  inputs.refuseChange();
}

void loaded(const Scene& scene, const Rows& inputs, std::size_t first, std::size_t end,
            double* out) {
  Eigen::VectorXd q;
  for (std::size_t i = first; i < end; ++i) {
    scene.copyRow(inputs, static_cast<py::ssize_t>(i), &q);
    const statics::Tip found = scene.model().tip(q);
    Eigen::Vector3d::Map(out + 3 * i) =
        found.converged() ? found.tip.translation
                          : Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  }
}

// Whether the memory from the first to the last number of the rows has a part in `out`.
bool overlap(const Rows& rows, const py::array& out) {
  if (rows.rows() == 0) return false;
  const char *begin = rows.data(), *end = begin + sizeof(double);
  const std::array<py::ssize_t, 2> spans{(rows.rows() - 1) * rows.rowStride(),
                                         (rows.columns() - 1) * rows.columnStride()};
  for (const py::ssize_t span : spans) (span < 0 ? begin : end) += span;
  const char* const first = static_cast<const char*>(out.data());
  return begin < first + out.nbytes() && first < end;
}

// The caller's array for the result, or a new one.
py::array resultFor(const Rows& inputs, const py::object& out) {
  const std::vector<py::ssize_t> shape = inputs.shapeOf({3});
  if (out.is_none()) return py::array_t<double>(shape);
  const bool fits = py::isinstance<py::array_t<double, py::array::c_style>>(out);
  const auto array = fits ? py::reinterpret_borrow<py::array>(out) : py::array();
  const bool same =
      fits && array.writeable() &&
      std::equal(shape.begin(), shape.end(), array.shape(), array.shape() + array.ndim());
  if (!same) {
    std::string expected = "(3,)";
    if (!inputs.single()) expected = "(" + std::to_string(inputs.rows()) + ", 3)";
    throw py::value_error(
        "out is no array for the result; expected a writeable float64 array of "
        "shape " +
        expected + " in the order of C");
  }
  if (overlap(inputs, array)) {
    throw py::value_error("out overlaps pressures_pa; expected memory of its own");
  }
  return array;
}

}  // namespace

py::array tips(const Scene& scene, const Rows& inputs, const py::object& out, std::size_t threads) {
  const py::array result = resultFor(inputs, out);
  auto* const numbers = static_cast<double*>(const_cast<void*>(result.data()));
  const auto count = static_cast<std::size_t>(inputs.rows());
  if (!scene.isLoaded() && count == 1) {
    scene.requireWithinLimits(inputs);
    Eigen::VectorXd q;
    scene.copyRow(inputs, 0, &q);
    Eigen::Vector3d::Map(numbers) = scene.arm().tip(q).translation;
    return result;
  }
  {
    const OthersRun others_run;
    if (scene.isLoaded()) {
      scene.requireWithinLimits(inputs);
      inPieces(count, kLoadedPiece, threads, [&](std::size_t first, std::size_t end) {
        loaded(scene, inputs, first, end, numbers);
      });
    } else {
      const model::TipBatch batch(scene.arm());
      inPieces(count, kPiece, threads, [&](std::size_t first, std::size_t end) {
        closedForm(scene, batch, inputs, first, end, numbers);
      });
    }
  }
  return result;
}

}  // namespace helix_arm::python
