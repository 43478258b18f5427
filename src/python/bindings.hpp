#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <unistd.h>

#include "basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/statics/inverse.hpp"

/// Parts that the bindings share: arrays of a caller and of results, scenes, threads. The methods
/// of Scene whose names begin with _ get arguments that helix_arm.scene has checked, except arrays,
/// and return the fields of the dataclasses of helix_arm.results.
namespace helix_arm::python {

namespace py = pybind11;
using namespace py::literals;

/// Rows of numbers in a caller's array, read where they are, whatever its strides.
class Rows {
 public:
  /// One row (columns), or many (N, columns). Aligned arrays of float64 are not copied; other
  /// floats, integers, lists and tuples are converted.
  /// @param name  of the argument, for messages.
  /// @throws TypeError on another type or dtype, ValueError on another shape.
  Rows(const py::handle& given, const char* name, py::ssize_t columns);

  const std::string& name() const { return name_; }
  bool single() const { return single_; }  ///< one row, given without the first dimension
  py::ssize_t rows() const { return rows_; }
  py::ssize_t columns() const { return columns_; }
  double operator()(py::ssize_t row, py::ssize_t column) const {
    return *reinterpret_cast<const double*>(data_ + row * row_stride_ + column * column_stride_);
  }
  Eigen::VectorXd row(py::ssize_t row) const;
  /// Shape of a result with one entry per row: what follows is that entry's shape.
  std::vector<py::ssize_t> shapeOf(const std::vector<py::ssize_t>& entry) const;
  /// @throws ValueError naming the argument and the row of an entry that is NaN or infinite.
  void requireFinite() const;

  /// Distances between neighbours [bytes].
  py::ssize_t rowStride() const { return row_stride_; }
  py::ssize_t columnStride() const { return column_stride_; }
  const char* data() const { return data_; }
  const py::array& array() const { return array_; }

 private:
  std::string name_;
  py::array array_;  // keeps the numbers alive
  const char* data_;
  bool single_;
  py::ssize_t rows_, columns_, row_stride_, column_stride_;
};

/// The float64 array of an argument, aligned, of any shape. Throws as Rows does.
py::array argumentArray(const py::handle& given, const char* name);

/// A new array with one entry per row of inputs, which threads without the interpreter write.
template <class Number>
class Entries {
 public:
  /// @param shape  of an entry: {} of a number.
  Entries(const Rows& rows, const std::vector<py::ssize_t>& shape)
      : array_(rows.shapeOf(shape)), first_(array_.mutable_data()) {
    for (const py::ssize_t size : shape) size_ *= size;
  }
  Number* at(std::size_t row) const { return first_ + static_cast<py::ssize_t>(row) * size_; }
  Number& operator[](std::size_t row) const { return *at(row); }
  py::ssize_t size() const { return size_; }  ///< of an entry
  /// The array; the number, if it is but one.
  py::object result() const {
    return array_.ndim() > 0 ? py::object(array_) : array_.attr("item")();
  }

 private:
  py::array_t<Number> array_;
  Number* first_;
  py::ssize_t size_ = 1;
};

/// New array of a vector (n) or a matrix (rows, columns), in the order of C.
template <class Derived>
py::array arrayOf(const Eigen::MatrixBase<Derived>& values) {
  std::vector<py::ssize_t> shape{values.rows()};
  if (Derived::ColsAtCompileTime != 1) shape.push_back(values.cols());
  py::array_t<typename Derived::Scalar> out(shape);
  auto* to = out.mutable_data();
  for (Eigen::Index i = 0; i < values.rows(); ++i) {
    for (Eigen::Index j = 0; j < values.cols(); ++j) *to++ = values(i, j);
  }
  return std::move(out);
}

/// Python's list of the function's results for each of the values.
template <class Values, class PartsOf>
py::list listOf(const Values& values, const PartsOf& partsOf) {
  py::list out;
  for (const auto& value : values) out.append(partsOf(value));
  return out;
}

/// Writes a position (3) [m] and a quaternion (4); NaN unless it was found.
void setPose(const lie::SE3& pose, bool found, double* position, double* quaternion);

/// Solvers of one model that are not in use, of any options: the last ones that were given back.
/// Making one samples a thousand starts, which takes as long as 50 targets. Threads may share them.
class Solvers {
 public:
  /// A solver of one thread, given back at its end.
  using Loan =
      std::unique_ptr<statics::InverseSolver, std::function<void(statics::InverseSolver*)>>;

  /// @param model  must outlive the solvers.
  explicit Solvers(const statics::ArmModel& model);
  /// @throws as InverseSolver does.
  Loan take(const statics::InverseOptions& options);

 private:
  struct Kept {
    statics::InverseOptions options;
    std::unique_ptr<statics::InverseSolver> solver;
  };

  void giveBack(const statics::InverseOptions& options,
                std::unique_ptr<statics::InverseSolver> solver) noexcept;

  const statics::ArmModel& model_;
  basics::Mutex mutex_;
  std::vector<Kept> kept_ HELIX_ARM_GUARDED_BY(mutex_);  // the last is at the end
};

/// A loaded scene, as Python holds it. Immutable, so threads may share it.
class Scene {
 public:
  /// @param path       of a scene file.
  /// @param overrides  keys and values as YAML text, as of --set.
  Scene(const std::string& path, const std::vector<io::Override>& overrides);

  const std::string& path() const { return path_; }
  const std::vector<io::Override>& overrides() const { return overrides_; }
  const io::Scene& scene() const { return scene_; }
  const statics::ArmModel& model() const { return scene_.model; }
  const model::Arm& arm() const { return scene_.arm; }
  /// Whether shapes are solved, under a load or along tapered sections.
  bool isLoaded() const { return !model().isLinear(); }
  /// Solvers that calls leave for the next ones.
  Solvers& solvers() const { return solvers_; }

  /// The inputs of an argument, one column per actuator.
  /// @throws as Rows does, and what a caller's filter makes of a warning of kPa.
  Rows inputs(const py::handle& given, const char* name) const;
  /// Copies a row of them.
  /// @throws std::invalid_argument naming argument, row, actuator and limits of one beyond these.
  void copyRow(const Rows& inputs, py::ssize_t row, Eigen::VectorXd* q) const;

 private:
  std::string path_;
  std::vector<io::Override> overrides_;
  io::Scene scene_;
  mutable Solvers solvers_;  // guarded by itself
};

void bindModel(py::class_<Scene>& scene);
void bindDynamics(py::module_& module, py::class_<Scene>& scene);
void bindMeasurements(py::class_<Scene>& scene);
/// Part for the node calibration of the library.
void bindRecordings(py::module_& module, py::class_<Scene>& scene);
/// Part for helix_arm.experiments of the library.
void bindExperiments(py::module_& module, py::class_<Scene>& scene);
/// Part for the nodes in Python of the library.
void bindNodes(py::module_& module, py::class_<Scene>& scene);

/// While it lives, other threads of Python run. A daemon thread that asks for the interpreter after
/// its end sleeps here until the process ends, as from Python 3.14 on. Before, Python ends it by
/// pthread_exit(), which unwinds the stack: py::gil_scoped_release then ends the process, as
/// destructors must not throw, and other destructors would release objects without the interpreter.
class OthersRun {
 public:
  OthersRun() : state_(PyEval_SaveThread()) {}
  ~OthersRun() { takeInterpreter(); }
  OthersRun(const OthersRun&) = delete;
  OthersRun& operator=(const OthersRun&) = delete;

  /// Whether a signal, such as that of Ctrl-C, raised an exception of Python. It is thrown when
  /// this object is gone.
  bool interrupted() {
    takeInterpreter();
    const bool raised = PyErr_CheckSignals() != 0;
    state_ = PyEval_SaveThread();
    return raised;
  }

 private:
  void takeInterpreter() noexcept {
    try {
      PyEval_RestoreThread(state_);
    } catch (...) {
      for (;;) ::pause();
    }
  }

  PyThreadState* state_;
};

/// Calls work(first, end) for pieces that make up [0, count), on so many threads (0: on all cores),
/// the caller being one. A piece begins at a multiple of `piece`.
/// @throws what work threw; the other threads then end early.
template <class Work>
void inPieces(std::size_t count, std::size_t piece, std::size_t threads, const Work& work) {
  if (threads == 0) threads = std::max(1u, std::thread::hardware_concurrency());
  if (threads == 1) piece = std::max<std::size_t>(count, 1);
  std::atomic<std::size_t> next{0};
  const auto run = [&] {
    try {
      for (std::size_t first; (first = next.fetch_add(piece)) < count;) {
        work(first, std::min(count, first + piece));
      }
    } catch (...) {
      next = count;
      throw;
    }
  };
  std::vector<std::future<void>> others;
  for (std::size_t i = 1; i < threads && i * piece < count; ++i) {
    others.push_back(std::async(std::launch::async, run));
  }
  run();
  for (std::future<void>& other : others) other.get();
}

/// Rows that are the work of one thread at a time; results do not depend on the division.
struct Piece {
  std::size_t closed_form, solved;
};

/// Calls work(row, q) with a copy of each row of inputs, while other threads of Python run.
/// @throws as Scene::copyRow().
template <class Work>
void forEachRow(const Scene& scene, const Rows& inputs, const Piece& piece, std::size_t threads,
                const Work& work) {
  std::optional<OthersRun> others_run;
  // For one row without load, letting others run costs more than the row.
  if (inputs.rows() > 1 || scene.isLoaded()) others_run.emplace();
  inPieces(static_cast<std::size_t>(inputs.rows()),
           scene.isLoaded() ? piece.solved : piece.closed_form, threads,
           [&](std::size_t first, std::size_t end) {
             Eigen::VectorXd q;
             for (std::size_t row = first; row < end; ++row) {
               scene.copyRow(inputs, static_cast<py::ssize_t>(row), &q);
               work(row, q);
             }
           });
}

}  // namespace helix_arm::python
