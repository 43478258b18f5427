#include "data.hpp"

#include "arguments.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/content_hash.hpp"

namespace helix_arm::python {
namespace {

constexpr py::ssize_t kMostRows = 200'000;  // as of a file
constexpr py::ssize_t kMostColumns = 1000;

io::DataSet tableOf(const py::dict& columns, const std::string& name) {
  basics::require(!columns.empty() && static_cast<py::ssize_t>(columns.size()) <= kMostColumns,
                  name, " has ", columns.size(), " columns; expected 1 to ", kMostColumns);
  io::DataSet out;
  out.path = name;
  for (const auto& [key, value] : columns) {
    const std::string column = textOf(key, ("a name of a column of " + name).c_str());
    const std::string where = name + "[\"" + column.substr(0, 60) + "\"]";
    const py::array array = arrayOf(value, where.c_str());
    const bool fits = array.ndim() == 1 && array.size() > 0 && array.size() <= kMostRows &&
                      (out.columns.empty() || array.size() == out.values.rows());
    basics::require(fits, where, " has shape ", shapeText(array), "; expected 1 to ", kMostRows,
                    " numbers, as many as the other columns");
    if (out.columns.empty()) out.values.resize(array.size(), static_cast<int>(columns.size()));
    const Rows numbers(array, where.c_str(), array.size());
    requireFinite(numbers);
    out.values.col(static_cast<int>(out.columns.size())) = numbers.row(0);
    out.columns.push_back(column);
  }
  for (int row = 0; row < out.values.rows(); ++row) out.lines.push_back(row + 1);
  std::string bytes;
  for (const std::string& column : out.columns) bytes += column + ",";
  bytes.append(reinterpret_cast<const char*>(out.values.data()),
               static_cast<std::size_t>(out.values.size()) * sizeof(double));
  out.sha256 = io::sha256Of(bytes);
  return out;
}

}  // namespace

io::DataSet dataSetOf(const py::handle& given, const std::string& name) {
  if (py::isinstance<py::str>(given)) return io::loadDataSet(textOf(given, name.c_str()));
  if (py::isinstance<py::dict>(given)) {
    return tableOf(py::reinterpret_borrow<py::dict>(given), name);
  }
  refuseType(given, name.c_str(), "the path of a data set, or a dict of its columns");
}

}  // namespace helix_arm::python
