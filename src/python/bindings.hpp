#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <optional>
#include <thread>
#include <vector>

#include <pybind11/pybind11.h>
#include <unistd.h>

#include "scene.hpp"

/// The methods of Scene. Those whose names begin with _ get arguments that helix_arm.scene has
/// checked, except arrays, and return the fields of the dataclasses of helix_arm.results.
namespace helix_arm::python {

void bindModel(py::module_& module, py::class_<Scene>& scene);
void bindInverse(py::class_<Scene>& scene);
void bindMeasurements(py::class_<Scene>& scene);

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

/// Calls work(first, end) for pieces that together are [0, count), on this many threads (0: on all
/// cores), or as many as the system can make; the caller is one of them. A piece begins at a
/// multiple of `piece`.
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
