#include "workspace_maps.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>

#include "helix_arm/basics/median.hpp"
#include "helix_arm/statics/workspace.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;

constexpr int kMostCells = 80;        // along the longest side
constexpr double kLeastWidth = 1e-3;  // of a plane, as a part of the longest side
constexpr double kKeptDigits = 1e4;   // of a cell's value

struct Plane {
  int across, up;
};
constexpr Plane kPlanes[] = {{0, 2}, {1, 2}, {0, 1}};
const char* const kAxes[] = {"x", "y", "z"};
const char* const kTitles[] = {"Tip displacement per kPa of pressure error",
                               "Tip displacement per mm of free length error",
                               "Tip displacement per % of stiffness error"};

double rounded(double value) {
  if (value == 0) return 0;
  const double scale = std::pow(10.0, std::floor(std::log10(std::abs(value)))) / kKeptDigits;
  return std::round(value / scale) * scale;
}

// Square cells over a plane, and the points in each.
class Grid {
 public:
  Grid(const Plane& plane, const Eigen::AlignedBox3d& bounds, double cell)
      : plane_(plane), cell_(cell) {
    for (const int side : {0, 1}) {
      const int axis = side == 0 ? plane.across : plane.up;
      const double width = bounds.sizes()[axis];
      count_[side] = static_cast<int>(width / cell) + 1;
      least_[side] = bounds.center()[axis] - 0.5 * cell * count_[side];
    }
    members_.resize(static_cast<std::size_t>(count_[0]) * static_cast<std::size_t>(count_[1]));
  }

  void add(const Eigen::Vector3d& tip, int point) {
    const int column = indexOf(tip[plane_.across], 0), row = indexOf(tip[plane_.up], 1);
    members_[static_cast<std::size_t>(row * count_[0] + column)].push_back(point);
  }

  json map(const std::function<double(const std::vector<int>&)>& valueOf) const {
    json rows = json::array();
    for (int row = 0; row < count_[1]; ++row) {
      json cells = json::array();
      for (int column = 0; column < count_[0]; ++column) {
        const auto& members = members_[static_cast<std::size_t>(row * count_[0] + column)];
        cells.push_back(members.empty() ? json() : json(rounded(valueOf(members))));
      }
      rows.push_back(std::move(cells));
    }
    return {{"across", kAxes[plane_.across]},
            {"up", kAxes[plane_.up]},
            {"extent",
             {least_[0], least_[0] + cell_ * count_[0], least_[1], least_[1] + cell_ * count_[1]}},
            {"cells", std::move(rows)}};
  }

 private:
  int indexOf(double value, int side) const {
    const int index = static_cast<int>(std::floor((value - least_[side]) / cell_));
    return std::clamp(index, 0, count_[side] - 1);
  }

  Plane plane_;
  double cell_;
  int count_[2];
  double least_[2];
  std::vector<std::vector<int>> members_;
};

json named(json map, const char* quantity, const char* title, const char* unit) {
  map["quantity"] = quantity;
  map["title"] = title;
  map["unit"] = unit;
  return map;
}

}  // namespace

json mapsJson(const std::vector<CloudPoint>& points, bool sensitivity) {
  json maps = json::array();
  Eigen::AlignedBox3d bounds;
  for (const CloudPoint& point : points) bounds.extend(point.tip);
  const double longest = points.empty() ? 0.0 : bounds.sizes().maxCoeff();
  for (const Plane& plane : kPlanes) {
    const double width = std::min(bounds.sizes()[plane.across], bounds.sizes()[plane.up]);
    if (!(longest > 0) || width < kLeastWidth * longest) continue;
    Grid grid(plane, bounds, longest / kMostCells);
    for (std::size_t i = 0; i < points.size(); ++i) grid.add(points[i].tip, static_cast<int>(i));
    maps.push_back(named(grid.map([](const std::vector<int>& members) {
      return static_cast<double>(members.size());
    }),
                         "points", "Tip positions per cell", "points"));
    for (int k = 0; k < statics::kSensitivities && sensitivity; ++k) {
      const auto median = [&points, k](const std::vector<int>& members) {
        std::vector<double> values;
        for (const int i : members) {
          values.push_back(points[static_cast<std::size_t>(i)].sensitivity[k]);
        }
        return basics::medianOf(std::move(values));
      };
      maps.push_back(named(grid.map(median), statics::kSensitivityNames[k], kTitles[k], "m"));
    }
  }
  return maps;
}

}  // namespace helix_arm::cli
