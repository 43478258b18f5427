#include "body_table.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include "basics/pi.hpp"
#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "io/document/atomic_file.hpp"
#include "io/document/document.hpp"
#include "io/document/number.hpp"

namespace helix_arm::io {
namespace {

using CellTexts = std::vector<std::string>;

constexpr std::size_t kHeadBytes = 1U << 16U;  // in which a header ends
constexpr double kUnitTolerance = 1e-2;

std::string trimmedCell(const std::string& text) {
  const auto first = text.find_first_not_of(" \t\r\"\xEF\xBB\xBF");
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(" \t\r\"") + 1 - first);
}

CellTexts cellsOf(const std::string& line) {
  CellTexts out;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, ',');) out.push_back(trimmedCell(cell));
  return out;
}

std::string cellAt(const CellTexts& row, std::size_t column) {
  return column < row.size() ? row[column] : std::string();
}

// Columns of one body, and the units of its numbers.
struct BodyColumns {
  std::array<int, 3> position = {-1, -1, -1};
  std::array<int, 4> rotation = {-1, -1, -1, -1};  // x, y, z, w; without w a vector of angles
  double length = 1.0, angle = 1.0;                // [m], [rad]

  // Column k holds the entry `axis` of a rotation ('R') or of a position, in this unit.
  void set(std::size_t k, char kind, int axis, double unit) {
    if (kind == 'R') {
      rotation[static_cast<std::size_t>(axis)] = static_cast<int>(k);
      angle = unit;
    } else if (axis < 3) {
      position[static_cast<std::size_t>(axis)] = static_cast<int>(k);
      length = unit;
    }
  }
  bool hasPosition() const { return *std::min_element(position.begin(), position.end()) >= 0; }
  bool hasRotation() const { return rotation[0] >= 0 && rotation[1] >= 0 && rotation[2] >= 0; }
};

// Layout of a file.
struct Layout {
  std::size_t first_row = 0;  // of numbers
  int time = -1;              // column of times; of frames if `rate` is given
  std::optional<double> rate;
  std::vector<BodyColumns> bodies;
};

double unitOf(const std::string& text) {
  if (text == "mm" || text == "Millimeters") return 1e-3;
  if (text == "cm" || text == "Centimeters") return 1e-2;
  if (text == "deg") return basics::kPi / 180;
  return 1.0;
}

int axisOf(const std::string& text) {
  constexpr char kAxes[] = "XYZW";
  const auto* const at = std::find(kAxes, kAxes + 4, text.empty() ? '?' : text.back());
  return at == kAxes + 4 ? -1 : static_cast<int>(at - kAxes);
}

// time_s, NAME_x_m ..
std::optional<Layout> tableLayout(const std::vector<CellTexts>& head,
                                  const std::vector<std::string>& names) {
  const auto is_comment = [](const CellTexts& row) {
    return row.empty() || row[0].rfind('#', 0) == 0;
  };
  const auto header = std::find_if_not(head.begin(), head.end(), is_comment);
  if (header == head.end()) return std::nullopt;
  const auto column = [&header](const std::string& name) {
    const auto found = std::find(header->begin(), header->end(), name);
    return found == header->end() ? -1 : static_cast<int>(found - header->begin());
  };
  const std::string suffix = "_x_m";
  const bool has_bodies = std::any_of(header->begin(), header->end(), [&](const auto& cell) {
    return cell.size() > suffix.size() &&
           cell.compare(cell.size() - suffix.size(), suffix.size(), suffix) == 0;
  });
  if (!has_bodies) return std::nullopt;
  Layout out;
  out.first_row = static_cast<std::size_t>(header - head.begin()) + 1;
  out.time = column("time_s");
  for (const std::string& name : names) {
    out.bodies.push_back(
        {{column(name + "_x_m"), column(name + "_y_m"), column(name + "_z_m")},
         {column(name + "_qx"), column(name + "_qy"), column(name + "_qz"), column(name + "_qw")}});
  }
  return out;
}

// Rows "..,Name,..", "..,Rotation,Position,.." and "Frame,Time (Seconds),X,Y,Z,W,..".
std::optional<Layout> motiveLayout(const std::vector<CellTexts>& head,
                                   const std::vector<std::string>& names) {
  if (head.empty() || cellAt(head[0], 0) != "Format Version") return std::nullopt;
  Layout out;
  const auto unit = std::find(head[0].begin(), head[0].end(), "Length Units");
  const double length = unit < head[0].end() - 1 ? unitOf(*(unit + 1)) : 1.0;
  const CellTexts *types = nullptr, *titles = nullptr;
  for (std::size_t row = 1; row < head.size() && out.first_row == 0; ++row) {
    const std::string label = cellAt(head[row], 1);
    if (label == "Type") types = &head[row];
    if (label == "Name") titles = &head[row];
    if (cellAt(head[row], 0) == "Frame") out.first_row = row + 1;
  }
  if (out.first_row == 0 || titles == nullptr) return std::nullopt;
  out.time = 1;
  const CellTexts &axes = head[out.first_row - 1], &kinds = head[out.first_row - 2];
  for (const std::string& name : names) {
    BodyColumns& body = out.bodies.emplace_back();
    for (std::size_t k = 2; k < axes.size(); ++k) {
      const bool is_body = types == nullptr || cellAt(*types, k) == "Rigid Body";
      const int axis = axisOf(axes[k]);
      if (!is_body || cellAt(*titles, k) != name || axis < 0) continue;
      if (cellAt(kinds, k) == "Rotation") body.set(k, 'R', axis, 1.0);
      if (cellAt(kinds, k) == "Position") body.set(k, 'T', axis, length);
    }
  }
  return out;
}

// "Objects" or "Segments", a rate, names, "Frame,Sub Frame,RX,..,TX,..", units.
std::optional<Layout> viconLayout(const std::vector<CellTexts>& head,
                                  const std::vector<std::string>& names) {
  const auto axes = std::find_if(head.begin(), head.end(), [](const CellTexts& row) {
    return cellAt(row, 0) == "Frame" && cellAt(row, 1) == "Sub Frame";
  });
  if (axes == head.end() || axes - head.begin() < 2 || head.end() - axes < 3) return std::nullopt;
  const CellTexts &titles = *(axes - 1), &units = *(axes + 1);
  Layout out;
  out.first_row = static_cast<std::size_t>(axes - head.begin()) + 2;
  out.time = 0;
  out.rate = parseNumber(cellAt(*(axes - 2), 0));
  for (const std::string& name : names) {
    BodyColumns& body = out.bodies.emplace_back();
    std::string title;  // stands above the first of its columns
    for (std::size_t k = 2; k < axes->size(); ++k) {
      if (const std::string& here = cellAt(titles, k); !here.empty()) title = here;
      const std::string after = title.substr(title.rfind(':') + 1);
      const std::string& cell = (*axes)[k];
      const int axis = axisOf(cell);
      if ((title != name && after != name) || axis < 0) continue;
      if (cell[0] == 'R' || cell[0] == 'T') body.set(k, cell[0], axis, unitOf(cellAt(units, k)));
    }
  }
  return out;
}

std::optional<Layout> layoutOf(const std::vector<CellTexts>& head,
                               const std::vector<std::string>& names) {
  for (const auto& kind : {tableLayout, motiveLayout, viconLayout}) {
    if (auto layout = kind(head, names)) return layout;
  }
  return std::nullopt;
}

std::vector<CellTexts> rowsOf(const std::string& text, std::size_t most) {
  std::vector<CellTexts> out;
  std::istringstream in(text.substr(0, most));
  for (std::string line; std::getline(in, line);) out.push_back(cellsOf(line));
  return out;
}

// Nothing where the cells of the position are empty; a fault where one is no number.
std::optional<lie::SE3> poseOf(const CellTexts& row, const BodyColumns& body, int line,
                               FaultList& faults) {
  const auto number = [&](int column, double unit) {
    const std::string cell = cellAt(row, static_cast<std::size_t>(column));
    const std::optional<double> value = parseNumber(cell);
    if (!value && !cell.empty()) faults.add(line, "holds a cell that is no number");
    return value ? unit * *value : std::nan("");
  };
  lie::SE3 X;
  for (int i = 0; i < 3; ++i) X.translation[i] = number(body.position[std::size_t(i)], body.length);
  if (!X.translation.allFinite()) return std::nullopt;
  if (!body.hasRotation()) return X;
  Eigen::Vector3d r;
  for (int i = 0; i < 3; ++i) r[i] = number(body.rotation[std::size_t(i)], body.angle);
  if (!r.allFinite()) return std::nullopt;
  if (body.rotation[3] < 0) {
    X.rotation = Eigen::AngleAxisd(r.norm(), r.normalized()).toRotationMatrix();
    return X;
  }
  const Eigen::Quaterniond q(number(body.rotation[3], 1), r.x() / body.angle, r.y() / body.angle,
                             r.z() / body.angle);
  if (!(std::abs(q.norm() - 1) <= kUnitTolerance)) {
    faults.add(line, "has a quaternion that is not of norm 1");
    return std::nullopt;
  }
  X.rotation = q.normalized().toRotationMatrix();
  return X;
}

}  // namespace

bool isBodyTable(const std::string& path) {
  FaultList faults(path);
  const auto text = readTextFile(path, kMostTableBytes, faults);
  return text && layoutOf(rowsOf(*text, kHeadBytes), {});
}

BodyTable loadBodyTable(const std::string& path, const std::vector<std::string>& names) {
  FaultList faults(path);
  const auto text = readTextFile(path, kMostTableBytes, faults);
  faults.throwIfAny();
  const std::vector<CellTexts> rows = rowsOf(*text, text->size());
  const std::optional<Layout> layout = layoutOf(rows, names);
  if (!layout || layout->time < 0 || (layout->time == 0 && layout->rate.value_or(0) < 0)) {
    throw DocumentError(path +
                        " is no recording of bodies; expected time_s and NAME_x_m .., or an "
                        "export of Motive or Vicon");
  }
  BodyTable out;
  out.sha256 = sha256Of(*text);
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (layout->bodies[i].hasPosition()) continue;
    faults.add(0, "has no position of body " + names[i] + " of the scene");
  }
  faults.throwIfAny();
  for (std::size_t k = layout->first_row; k < rows.size(); ++k) {
    const int line = static_cast<int>(k) + 1;
    const std::string cell = cellAt(rows[k], static_cast<std::size_t>(layout->time));
    const std::optional<double> time = parseNumber(cell);
    if (cell.empty()) continue;
    if (!time) {
      faults.add(line, "has a time that is no number");
      continue;
    }
    out.time.push_back(layout->rate ? *time / *layout->rate : *time);
    if (out.time.size() > 1 && !(out.time.back() > out.time[out.time.size() - 2])) {
      faults.add(line, "has a time that does not rise");
    }
    out.poses.emplace_back();
    for (const BodyColumns& body : layout->bodies) {
      out.poses.back().push_back(poseOf(rows[k], body, line, faults));
    }
  }
  faults.throwIfAny();
  if (out.time.empty()) throw DocumentError(path + " has no rows");
  return out;
}

}  // namespace helix_arm::io
