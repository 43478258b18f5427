#include "data.hpp"

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
    if (!py::isinstance<py::str>(key)) {
      throw py::type_error(name + " has a key that is no text; expected names of columns");
    }
    const auto column = key.cast<std::string>();
    const std::string where = name + "[\"" + column.substr(0, 60) + "\"]";
    const py::array array = arrayOf(value, where.c_str());
    if (out.columns.empty()) out.values.resize(array.size(), static_cast<int>(columns.size()));
    basics::require(array.ndim() == 1 && array.size() == out.values.rows() && array.size() > 0 &&
                        array.size() <= kMostRows,
                    where, " has shape ", shapeText(array), "; expected 1 to ", kMostRows,
                    " numbers, as many as the other columns");
    const Rows numbers(array, where.c_str(), array.size());
    requireFinite(numbers, where.c_str());
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
  if (py::isinstance<py::str>(given)) return io::loadDataSet(given.cast<std::string>());
  if (py::isinstance<py::dict>(given)) {
    return tableOf(py::reinterpret_borrow<py::dict>(given), name);
  }
  throw py::type_error(name + " is of type " +
                       std::string(py::str(py::type::of(given).attr("__name__"))) +
                       "; expected the path of a data set, or a dict of its columns");
}

}  // namespace helix_arm::python
