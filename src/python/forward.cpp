#include <algorithm>
#include <array>
#include <cstdlib>
#include <limits>
#include <memory>
#include <vector>

#include <sys/mman.h>

#include "arrays.hpp"
#include "bindings.hpp"
#include "helix_arm/model/batch.hpp"
#include "scene.hpp"

namespace helix_arm::python {

namespace {

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
// Work of one thread at a time, about 0.1 ms in closed form.
constexpr std::size_t kForwardPiece = 1024;
constexpr std::size_t kLoadedForwardPiece = 16;

constexpr std::size_t kLargePage = std::size_t{2} << 20;  // [bytes]

// Shapes at one row or many rows of inputs. Rows without equilibrium hold NaN.
class Forward {
 public:
  Forward(const Scene& scene, const Rows& inputs, std::size_t threads)
      : single_(inputs.single()),
        rows_(inputs.rows()),
        sections_(scene.arm().sectionCount()),
        numbers_(numbers(static_cast<std::size_t>(inputs.numbersOf(7 + 6 * sections_)))),
        tips_(numbers_.get()),
        quaternions_(tips_ + 3 * rows_),
        twists_(quaternions_ + 4 * rows_),
        converged_(new bool[static_cast<std::size_t>(rows_)]) {
    scene.requireWithinLimits(inputs);
    inPieces(static_cast<std::size_t>(rows_),
             scene.isLoaded() ? kLoadedForwardPiece : kForwardPiece, threads,
             [&](std::size_t first, std::size_t end) { fill(scene, inputs, first, end); });
  }

  // Views of the numbers, which `self` owns.
  py::array tips(const py::object& self) const { return view(self, tips_, {3}); }
  py::array quaternions(const py::object& self) const { return view(self, quaternions_, {4}); }
  py::array twists(const py::object& self) const { return view(self, twists_, {sections_, 6}); }
  py::object converged() const {
    if (single_) return py::bool_(converged_[0]);
    return copyOf(converged_.get(), {rows_});
  }

  py::ssize_t rows() const { return rows_; }

 private:
  struct Free {
    void operator()(double* numbers) const { std::free(numbers); }
  };

  // Memory without initial values: every entry is written.
  // The kernel clears and maps each page when it is first written, which takes several times as
  // long as a page of shapes: so large memory asks for large pages, as NumPy's does.
  static std::unique_ptr<double[], Free> numbers(std::size_t count) {
    const std::size_t bytes = std::max(count, std::size_t{1}) * sizeof(double);
    const bool large = bytes >= 2 * kLargePage;
    const std::size_t whole = (bytes + kLargePage - 1) / kLargePage * kLargePage;
    void* const memory = large ? std::aligned_alloc(kLargePage, whole) : std::malloc(bytes);
    if (memory == nullptr) throw std::bad_alloc();
    if (large) ::madvise(memory, whole, MADV_HUGEPAGE);  // what a kernel without them refuses
    return std::unique_ptr<double[], Free>(static_cast<double*>(memory));
  }

  py::array view(const py::object& self, const double* first,
                 std::initializer_list<py::ssize_t> entry) const {
    py::array::ShapeContainer shape;
    if (!single_) shape->push_back(rows_);
    shape->insert(shape->end(), entry.begin(), entry.end());
    return py::array_t<double>(std::move(shape), first, self);
  }

  void fill(const Scene& scene, const Rows& inputs, std::size_t first, std::size_t end) {
    const bool loaded = scene.isLoaded();
    Eigen::VectorXd q;
    for (std::size_t row = first; row < end; ++row) {
      scene.copyRow(inputs, static_cast<py::ssize_t>(row), &q);
      if (loaded) {
        const statics::Solution solution = scene.model().solve(q);
        converged_[row] = solution.converged();
        set(row, solution.tip, solution.shape.twists());
        continue;
      }
      const model::Twists twists = scene.arm().twists(q);
      converged_[row] = true;
      set(row, scene.arm().tipOf(twists), twists);
    }
  }

  void set(std::size_t row, const lie::SE3& tip, const model::Twists& twists) {
    setPose(tip, converged_[row], &tips_[3 * row], &quaternions_[4 * row]);
    double* const to = &twists_[6 * sections_ * row];
    if (converged_[row]) {
      std::copy_n(twists.data(), 6 * sections_, to);
    } else {
      std::fill_n(to, 6 * sections_, kNoNumber);
    }
  }

  bool single_;
  py::ssize_t rows_;
  int sections_;
  std::unique_ptr<double[], Free> numbers_;  // tips, quaternions, twists
  double *tips_, *quaternions_, *twists_;    // in numbers_
  std::unique_ptr<bool[]> converged_;
};

Forward forward(const Scene& scene, const py::handle& pressures, const py::handle& threads) {
  const Rows inputs = scene.inputs(pressures, "pressures_pa");
  const std::size_t count = threadCount(threads);
  // For one row without load, letting others run costs more than the row.
  if (inputs.rows() <= 1 && !scene.isLoaded()) return Forward(scene, inputs, 1);
  const OthersRun others_run;
  return Forward(scene, inputs, count);
}

py::dict asDict(const py::object& self) {
  const auto& forward = self.cast<const Forward&>();
  py::dict out;
  out["tips"] = forward.tips(self);
  out["quaternions_xyzw"] = forward.quaternions(self);
  out["twists"] = forward.twists(self);
  out["converged"] = forward.converged();
  return out;
}

template <class Get>
auto field(Get get) {
  return [get](const py::object& self) { return (self.cast<const Forward&>().*get)(self); };
}

// Work of one thread at a time; a tip does not depend on the division.
constexpr std::size_t kTipsPiece = 16384;
constexpr std::size_t kLoadedTipsPiece = 16;

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
        found.converged() ? found.tip.translation : Eigen::Vector3d::Constant(kNoNumber);
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
        "out is no array for the result; expected a writeable float64 array of shape " + expected +
        " in the order of C");
  }
  if (overlap(inputs, array)) {
    throw py::value_error("out overlaps pressures_pa; expected memory of its own");
  }
  return array;
}

// Tip positions [m], shape (3,) or (N, 3). Rows without equilibrium hold NaN.
// @param out  array for them, or none: a new one.
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
      inPieces(count, kLoadedTipsPiece, threads, [&](std::size_t first, std::size_t end) {
        loaded(scene, inputs, first, end, numbers);
      });
    } else {
      const model::TipBatch batch(scene.arm());
      inPieces(count, kTipsPiece, threads, [&](std::size_t first, std::size_t end) {
        closedForm(scene, batch, inputs, first, end, numbers);
      });
    }
  }
  return result;
}

constexpr int kMostPoints = 100000;
constexpr std::size_t kCurvePiece = 64;
constexpr std::size_t kLoadedCurvePiece = 8;

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
    inPieces(rows, scene.isLoaded() ? kLoadedCurvePiece : kCurvePiece, thread_count,
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

void bindForward(py::module_& module, py::class_<Scene>& scene) {
  py::class_<Forward>(module, "Forward",
                      "Shapes at one row or N rows of pressures. Rows in which no shape balances "
                      "the load hold NaN.")
      .def_property_readonly("tips", field(&Forward::tips),
                             "(3,) or (N, 3) positions of the tip, base frame [m].")
      .def_property_readonly(
          "quaternions_xyzw", field(&Forward::quaternions),
          "(4,) or (N, 4) unit quaternions x, y, z, w of the tip's frame, base frame; w >= 0.")
      .def_property_readonly("twists", field(&Forward::twists),
                             "(sections, 6) or (N, sections, 6) twist of each section over its "
                             "length, v [m] and w [rad]; under load the mean.")
      .def_property_readonly("converged", &Forward::converged,
                             "bool, or (N,) bools: whether a shape balances the load.")
      .def("to_dict", asDict, "The fields as a dict of arrays.")
      .def("__len__", &Forward::rows)
      .def("__repr__", [](const Forward& forward) {
        return "<helix_arm.Forward of " + std::to_string(forward.rows()) +
               (forward.rows() == 1 ? " row>" : " rows>");
      });
  scene.def("_forward", forward, py::arg("pressures_pa"), py::arg("threads"));
  scene.def(
      "_tips",
      [](const Scene& self, const py::handle& pressures, const py::object& out,
         const py::handle& threads) {
        const Rows inputs = self.inputs(pressures, "pressures_pa");
        return tips(self, inputs, out, threadCount(threads));
      },
      py::arg("pressures_pa"), py::arg("out"), py::arg("threads"));
}

void bindCurve(py::class_<Scene>& scene) {
  scene.def("_curve", curve, py::arg("pressures_pa"), py::arg("points"), py::arg("threads"));
}

}  // namespace helix_arm::python
