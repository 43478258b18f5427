#include "arguments.hpp"

#include <algorithm>
#include <limits>
#include <thread>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::python {
namespace {

constexpr int kMostThreads = 1024;

// What Python's conversion said names no argument.
py::object forget(PyObject* converted) {
  if (converted == nullptr) PyErr_Clear();
  return py::reinterpret_steal<py::object>(converted);
}

}  // namespace

void refuseType(const py::handle& given, const char* name, const char* expected) {
  throw py::type_error(std::string(name) + " is of type " +
                       std::string(py::str(py::type::of(given).attr("__name__"))) + "; expected " +
                       expected);
}

std::int64_t integerOf(const py::handle& given, const char* name, std::int64_t lower,
                       std::int64_t upper) {
  const bool flag = PyBool_Check(given.ptr()) != 0;
  const py::object index = flag ? py::object() : forget(PyNumber_Index(given.ptr()));
  if (!index) refuseType(given, name, "an int");
  int overflow = 0;
  const std::int64_t value = PyLong_AsLongLongAndOverflow(index.ptr(), &overflow);
  if (overflow == 0 && value >= lower && value <= upper) return value;
  const std::string text = overflow != 0 ? "beyond 64 bits" : std::to_string(value);
  throw py::value_error(std::string(name) + " is " + text + "; expected " + std::to_string(lower) +
                        " to " + std::to_string(upper));
}

double numberOf(const py::handle& given, const char* name) {
  const bool text = py::isinstance<py::str>(given) || py::isinstance<py::bytes>(given);
  const py::object number = text ? py::object() : forget(PyNumber_Float(given.ptr()));
  if (!number) refuseType(given, name, "a number");
  return PyFloat_AS_DOUBLE(number.ptr());
}

bool flagOf(const py::handle& given, const char* name) {
  if (!py::isinstance<py::bool_>(given)) refuseType(given, name, "True or False");
  return given.ptr() == Py_True;
}

std::string textOf(const py::handle& given, const char* name) {
  if (!py::isinstance<py::str>(given)) refuseType(given, name, "a str");
  const py::object bytes = forget(PyUnicode_AsUTF8String(given.ptr()));
  if (!bytes) {
    throw py::value_error(std::string(name) + " is " + std::string(py::repr(given)).substr(0, 60) +
                          ", which UTF-8 cannot hold; expected text without surrogates");
  }
  return py::reinterpret_borrow<py::bytes>(bytes);
}

std::size_t threadCount(const py::handle& given) {
  constexpr auto kMost = std::numeric_limits<std::int64_t>::max();
  const std::int64_t threads = integerOf(given, "threads", -kMost, kMost);
  basics::require(threads >= 0 && threads <= kMostThreads, "threads is ", threads,
                  "; expected 1 to ", kMostThreads, ", or 0 for all cores");
  if (threads > 0) return static_cast<std::size_t>(threads);
  return std::max(1u, std::thread::hardware_concurrency());
}

}  // namespace helix_arm::python
