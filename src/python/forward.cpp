#include "forward.hpp"

#include <algorithm>
#include <limits>

#include <sys/mman.h>

#include "bindings.hpp"
#include "parallel.hpp"
#include "poses.hpp"

namespace helix_arm::python {
namespace {

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
// Work of one thread at a time, about 0.1 ms in closed form.
constexpr std::size_t kPiece = 1024;
constexpr std::size_t kLoadedPiece = 16;

constexpr std::size_t kLargePage = std::size_t{2} << 20;  // [bytes]

}  // namespace

// The kernel clears and maps each page when it is first written, which takes several times as long
// as a page of shapes: so large memory asks for large pages, as NumPy's does.
std::unique_ptr<double[], Forward::Free> Forward::numbers(std::size_t count) {
  const std::size_t bytes = std::max(count, std::size_t{1}) * sizeof(double);
  const bool large = bytes >= 2 * kLargePage;
  const std::size_t whole = (bytes + kLargePage - 1) / kLargePage * kLargePage;
  void* const memory = large ? std::aligned_alloc(kLargePage, whole) : std::malloc(bytes);
  if (memory == nullptr) throw std::bad_alloc();
  if (large) ::madvise(memory, whole, MADV_HUGEPAGE);  // what a kernel without them refuses
  return std::unique_ptr<double[], Free>(static_cast<double*>(memory));
}

Forward::Forward(const Scene& scene, const Rows& inputs, std::size_t threads)
    : single_(inputs.single()),
      rows_(inputs.rows()),
      sections_(scene.arm().sectionCount()),
      numbers_(numbers(static_cast<std::size_t>(inputs.numbersOf(7 + 6 * sections_)))),
      tips_(numbers_.get()),
      quaternions_(tips_ + 3 * rows_),
      twists_(quaternions_ + 4 * rows_),
      converged_(new bool[static_cast<std::size_t>(rows_)]) {
  scene.requireWithinLimits(inputs);
  inPieces(static_cast<std::size_t>(rows_), scene.isLoaded() ? kLoadedPiece : kPiece, threads,
           [&](std::size_t first, std::size_t end) { fill(scene, inputs, first, end); });
}

void Forward::fill(const Scene& scene, const Rows& inputs, std::size_t first, std::size_t end) {
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

void Forward::set(std::size_t row, const lie::SE3& tip, const model::Twists& twists) {
  setPose(tip, converged_[row], &tips_[3 * row], &quaternions_[4 * row]);
  double* const to = &twists_[6 * sections_ * row];
  if (converged_[row]) {
    std::copy_n(twists.data(), 6 * sections_, to);
  } else {
    std::fill_n(to, 6 * sections_, kNoNumber);
  }
}

py::array Forward::view(const py::object& self, const double* first,
                        std::initializer_list<py::ssize_t> entry) const {
  py::array::ShapeContainer shape;
  if (!single_) shape->push_back(rows_);
  shape->insert(shape->end(), entry.begin(), entry.end());
  return py::array_t<double>(std::move(shape), first, self);
}

py::array Forward::tips(const py::object& self) const { return view(self, tips_, {3}); }
py::array Forward::quaternions(const py::object& self) const {
  return view(self, quaternions_, {4});
}
py::array Forward::twists(const py::object& self) const {
  return view(self, twists_, {sections_, 6});
}
py::object Forward::converged() const {
  if (single_) return py::bool_(converged_[0]);
  return copyOf(converged_.get(), {rows_});
}

namespace {

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

}  // namespace

void bindForward(py::module_& module, py::class_<Scene>& scene) {
  py::class_<Forward>(module, "Forward",
                      "Shapes at one row or N rows of pressures. Rows in which no shape balances "
                      "the load hold NaN.")
      .def_property_readonly("tips", field(&Forward::tips),
                             "(3,) or (N, 3) positions of the tip, base frame [m].")
      .def_property_readonly("quaternions_xyzw", field(&Forward::quaternions),
                             "(4,) or (N, 4) unit quaternions x, y, z, w of the tip's frame, base "
                             "frame; w >= 0.")
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

}  // namespace helix_arm::python
