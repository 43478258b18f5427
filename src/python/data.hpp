#pragma once

#include "arrays.hpp"
#include "helix_arm/io/data_set.hpp"

namespace helix_arm::python {

/// A data set of an argument: a file, or a dict of columns (arrays of equal length), in the units
/// of their names as in a file.
/// @throws DocumentError with the faults of a file; TypeError or ValueError naming the argument.
io::DataSet dataSetOf(const py::handle& given, const std::string& name);

}  // namespace helix_arm::python
