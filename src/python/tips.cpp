#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "columns.hpp"
#include "forward.hpp"
#include "helix_arm/model/batch.hpp"
#include "parallel.hpp"

namespace helix_arm::python {
namespace {

// Rows that are computed at once: whole blocks, whose columns stay in the innermost caches. Pieces
// of threads are multiples of it, so that results do not depend on the number of threads.
constexpr std::size_t kChunk = model::kBatchBlock;
constexpr std::size_t kPiece = 64 * kChunk;
constexpr std::size_t kLoadedPiece = 16;
constexpr py::ssize_t kManyRows = 100'000;  // whose tips do not stay in a core's caches

// One column, one number after the other.
void readColumn(const Rows& rows, py::ssize_t column, std::size_t first, std::size_t count,
                double* to) {
  const py::ssize_t stride = rows.rowStride();
  const char* from =
      rows.data() + static_cast<py::ssize_t>(first) * stride + column * rows.columnStride();
  for (std::size_t j = 0; j < count; ++j, from += stride) {
    to[j] = *reinterpret_cast<const double*>(from);
  }
}

// Memory comes while the chunk before is computed.
void prefetch(const double* numbers, std::size_t count) {
  constexpr std::size_t kLine = 64 / sizeof(double);
  for (std::size_t i = 0; i < count; i += kLine) __builtin_prefetch(numbers + i, 0, 2);
}

// Without load: the columns of a chunk, and the batch.
void closedForm(const Scene& scene, const Rows& inputs, std::size_t first, std::size_t end,
                double* out) {
  const model::Arm& arm = scene.arm();
  const auto n = static_cast<std::size_t>(arm.actuatorCount());
  constexpr auto kNumber = static_cast<py::ssize_t>(sizeof(double));
  const bool in_columns = inputs.rowStride() == kNumber;
  const bool in_rows = !in_columns && inputs.columnStride() == kNumber &&
                       inputs.rowStride() == static_cast<py::ssize_t>(n) * kNumber;
  const bool past_caches = inputs.rows() >= kManyRows;
  std::vector<double> memory((n + 3) * kChunk);
  std::vector<double*> copies(n);
  for (std::size_t i = 0; i < n; ++i) copies[i] = memory.data() + i * kChunk;
  std::vector<const double*> columns(copies.begin(), copies.end());
  double* const x = memory.data() + n * kChunk;
  double* const y = x + kChunk;
  double* const z = y + kChunk;
  for (std::size_t begin = first; begin < end; begin += kChunk) {
    const std::size_t count = std::min(kChunk, end - begin);
    if (in_rows) {
      const double* const rows = reinterpret_cast<const double*>(inputs.data()) + n * begin;
      splitRows(rows, n, count, copies.data());
      prefetch(rows + n * kChunk, end - begin > 2 * kChunk ? n * kChunk : 0);
    }
    for (std::size_t i = 0; i < n; ++i) {
      if (in_columns) {
        columns[i] = reinterpret_cast<const double*>(inputs.data() + static_cast<py::ssize_t>(i) *
                                                                         inputs.columnStride()) +
                     begin;
      } else if (!in_rows) {
        readColumn(inputs, static_cast<py::ssize_t>(i), begin, count, copies[i]);
      }
      const model::Range& limits = arm.actuator(static_cast<int>(i)).limits;
      if (countOutside(columns[i], count, limits.lower, limits.upper) > 0) {
        scene.requireWithinLimits(inputs, "pressures_pa");  // says where
      }
    }
    model::batchTips(arm, columns.data(), count, x, y, z);
    joinRows(x, y, z, count, past_caches, out + 3 * begin);
  }
  if (past_caches) finishRows();
}

void loaded(const Scene& scene, const Rows& inputs, std::size_t first, std::size_t end,
            double* out) {
  for (std::size_t i = first; i < end; ++i) {
    const statics::Tip found = scene.model().tip(inputs.row(static_cast<py::ssize_t>(i)));
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
  py::array::ShapeContainer shape;
  if (!inputs.single()) shape->push_back(inputs.rows());
  shape->push_back(3);
  if (out.is_none()) return py::array_t<double>(std::move(shape));
  const bool fits = py::isinstance<py::array_t<double, py::array::c_style>>(out);
  const auto array = fits ? py::reinterpret_borrow<py::array>(out) : py::array();
  const bool same =
      fits && array.writeable() &&
      std::equal(shape->begin(), shape->end(), array.shape(), array.shape() + array.ndim());
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
    scene.requireWithinLimits(inputs, "pressures_pa");
    Eigen::Vector3d::Map(numbers) = scene.arm().tip(inputs.row(0)).translation;
    return result;
  }
  {
    const py::gil_scoped_release others_run;
    if (scene.isLoaded()) {
      scene.requireWithinLimits(inputs, "pressures_pa");
      inPieces(count, kLoadedPiece, threads, [&](std::size_t first, std::size_t end) {
        loaded(scene, inputs, first, end, numbers);
      });
    } else {
      inPieces(count, kPiece, threads, [&](std::size_t first, std::size_t end) {
        closedForm(scene, inputs, first, end, numbers);
      });
    }
  }
  return result;
}

}  // namespace helix_arm::python
