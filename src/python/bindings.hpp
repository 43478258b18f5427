#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <thread>
#include <vector>

#include <pybind11/pybind11.h>
#include <unistd.h>

#include "scene.hpp"

/// The methods of Scene, one function per file. Those whose names begin with _ return a dict with
/// the fields of a dataclass of helix_arm.results.
namespace helix_arm::python {

void bindForward(py::module_& module, py::class_<Scene>& scene);
void bindCalibrate(py::class_<Scene>& scene);
void bindCurve(py::class_<Scene>& scene);
void bindFit(py::class_<Scene>& scene);
void bindFollow(py::class_<Scene>& scene);
void bindInverse(py::class_<Scene>& scene);
void bindJacobian(py::class_<Scene>& scene);
void bindLocalize(py::class_<Scene>& scene);
void bindWorkspace(py::class_<Scene>& scene);
/// What the nodes in Python take from the library.
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

/// Calls work(first, end) for pieces that together are [0, count), on this many threads, or as many
/// as the system can make; the caller is one of them. A piece begins at a multiple of `piece`.
/// @throws what work threw first in one of the threads; the other threads then end early.
template <class Work>
void inPieces(std::size_t count, std::size_t piece, std::size_t threads, const Work& work) {
  const std::size_t pieces = (count + piece - 1) / piece;
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

}  // namespace helix_arm::python
