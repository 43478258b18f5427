#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <unistd.h>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/statics/inverse.hpp"

/// Parts that the bindings share: arrays of a caller and of results, scenes, threads. The methods
/// of Scene whose names begin with _ get arguments that helix_arm.scene has checked, except arrays,
/// and return the fields of the dataclasses of helix_arm.results.
namespace helix_arm::python {

namespace py = pybind11;
using namespace py::literals;

/// More rows than results can have. Python raises MemoryError.
class TooManyRows : public std::bad_alloc {
 public:
  explicit TooManyRows(std::string message) : message_(std::move(message)) {}
  const char* what() const noexcept override { return message_.c_str(); }

 private:
  std::string message_;
};

/// Rows of numbers in a caller's array, read where they are, whatever its strides. As other threads
/// may write it meanwhile, what was checked is copied, checked again and computed with.
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
  /// @throws TooManyRows naming the argument if no process can hold them.
  std::vector<py::ssize_t> shapeOf(const std::vector<py::ssize_t>& entry) const;
  /// @throws ValueError naming the argument and the row of an entry that is NaN or infinite.
  void requireFinite() const;
  /// Ends a call in which a number broke its rule after all were checked.
  [[noreturn]] void refuseChange() const;

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

/// New array of a vector (n) or a matrix (rows, columns), in the order of C. Numbers given to
/// py::array_t are copied by NumPy, which gives up the interpreter meanwhile: when it ends, a
/// daemon thread is then unwound through its caller.
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
  /// How many were made.
  std::int64_t made() const { return made_; }

 private:
  struct Kept {
    statics::InverseOptions options;
    std::unique_ptr<statics::InverseSolver> solver;
  };

  void giveBack(const statics::InverseOptions& options,
                std::unique_ptr<statics::InverseSolver> solver) noexcept;

  const statics::ArmModel& model_;
  std::atomic<std::int64_t> made_{0};
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
  bool isPneumatic() const {
    return pressures_.size() == static_cast<std::size_t>(arm().actuatorCount());
  }
  /// Solvers that calls leave for the next ones.
  Solvers& solvers() const { return solvers_; }

  /// The inputs of an argument, one row per actuator's input.
  /// @throws as Rows does, and what a caller's filter makes of a warning of kPa.
  Rows inputs(const py::handle& given, const char* name) const;
  /// @throws ValueError naming argument, row, actuator and limits.
  void requireWithinLimits(const Rows& inputs) const;
  /// Copies a row of inputs that were within the limits.
  /// @throws ValueError if they are not any more.
  void copyRow(const Rows& inputs, py::ssize_t row, Eigen::VectorXd* q) const;

 private:
  void warnOfKilopascals(const Rows& inputs) const;

  std::string path_;
  std::vector<io::Override> overrides_;
  io::Scene scene_;
  std::vector<int> pressures_;  // the actuators whose inputs are pressures
  mutable Solvers solvers_;     // guarded by itself
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
/// or as many as can be made, the caller being one. A piece begins at a multiple of `piece`.
/// @throws what work threw first in one of the threads; the other threads then end early.
template <class Work>
void inPieces(std::size_t count, std::size_t piece, std::size_t threads, const Work& work) {
  const std::size_t pieces = (count + piece - 1) / piece;
  if (threads == 0) threads = std::max(1u, std::thread::hardware_concurrency());
  threads = std::min(threads, pieces);
  if (threads <= 1) {
    if (count > 0) work(std::size_t{0}, count);
    return;
  }
  std::atomic<std::size_t> next{0};
  std::vector<std::exception_ptr> thrown(threads);
  const auto run = [&](std::size_t thread) {
    try {
      for (std::size_t i = next++; i < pieces; i = next++) {
        work(i * piece, std::min(count, (i + 1) * piece));
      }
    } catch (...) {
      thrown[thread] = std::current_exception();
      next = pieces;
    }
  };
  std::vector<std::thread> others;
  others.reserve(threads - 1);
  try {
    while (others.size() < threads - 1) others.emplace_back(run, others.size() + 1);
  } catch (const std::exception&) {
    // No more can be made; those that are there do the work.
  }
  run(0);
  for (std::thread& other : others) other.join();
  for (const std::exception_ptr& exception : thrown) {
    if (exception) std::rethrow_exception(exception);
  }
}

/// Rows that are the work of one thread at a time; results do not depend on the division.
struct Piece {
  std::size_t closed_form, solved;
};

/// Calls work(row, q) with a copy of each row of inputs, while other threads of Python run.
/// @throws as Scene::requireWithinLimits() and copyRow().
template <class Work>
void forEachRow(const Scene& scene, const Rows& inputs, const Piece& piece, std::size_t threads,
                const Work& work) {
  std::optional<OthersRun> others_run;
  // For one row without load, letting others run costs more than the row.
  if (inputs.rows() > 1 || scene.isLoaded()) others_run.emplace();
  scene.requireWithinLimits(inputs);
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
