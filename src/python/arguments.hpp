#pragma once

#include <cstdint>
#include <string>

#include <pybind11/pybind11.h>

/// Single values of a caller: what pybind11 would refuse without naming the argument.
namespace helix_arm::python {

namespace py = pybind11;

/// @param name  of the argument, for messages.
/// @throws TypeError if it is no integer (of Python or NumPy), ValueError if it is beyond lower to
///     upper.
std::int64_t integerOf(const py::handle& given, const char* name, std::int64_t lower,
                       std::int64_t upper);
/// @throws TypeError if it is no number.
double numberOf(const py::handle& given, const char* name);
/// @throws TypeError if it is neither True nor False.
bool flagOf(const py::handle& given, const char* name);
/// @throws TypeError if it is no str, ValueError if UTF-8 cannot hold it.
std::string textOf(const py::handle& given, const char* name);

/// Number of threads of an argument: 0 stands for all cores.
std::size_t threadCount(const py::handle& given);

/// Ends a call whose argument is of the wrong type.
[[noreturn]] void refuseType(const py::handle& given, const char* name, const char* expected);

}  // namespace helix_arm::python
