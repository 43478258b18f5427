#include "helix_arm/statics/load.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::statics {

bool Load::empty() const {
  const bool weightless =
      gravity.isZero(0) || std::all_of(mass.begin(), mass.end(), [](double m) { return m == 0; });
  return weightless && std::all_of(points.begin(), points.end(), [this](const PointLoad& point) {
           return forceOf(point).isZero(0) && point.moment.isZero(0);
         });
}

int Load::innerPlaces() const {
  std::set<std::pair<int, double>> places;
  for (const PointLoad& point : points) {
    if (point.s > 0 && point.s < 1) places.emplace(point.section, point.s);
  }
  return static_cast<int>(places.size());
}

Load Load::atEnds(const model::Links* links) const {
  Load out = *this;
  if (links == nullptr) return out;
  for (PointLoad& point : out.points) {
    if (point.s > 0 || point.section == 0) continue;
    --point.section;
    point.s = 1.0;
    point.offset = (*links)[point.section] * point.offset;
  }
  return out;
}

void Load::validate(int sections) const {
  const auto check = [](bool holds, const char* what, double value, const char* rule) {
    basics::requireValue(holds, "load", what, value, rule);
  };
  const auto notNegative = [](double x) { return std::isfinite(x) && x >= 0; };
  basics::requireKey(gravity.allFinite(), "load", "gravity is not finite");
  check(static_cast<int>(mass.size()) == sections, "the number of masses",
        static_cast<double>(mass.size()), "one per section");
  check(static_cast<int>(K_eps.size()) == sections, "the number of K_eps",
        static_cast<double>(K_eps.size()), "one per section");
  for (const double m : mass) check(notNegative(m), "a mass", m, "a finite value >= 0 [kg]");
  for (const double K : K_eps) check(std::isfinite(K) && K > 0, "K_eps", K, "a value > 0 [N]");
  check(tables.empty() || static_cast<int>(tables.size()) == sections,
        "the number of stiffness tables", static_cast<double>(tables.size()),
        "one per section, or none");
  for (const StiffnessTable& table : tables) table.validate("load", "a factor on K_eps");
  for (const PointLoad& point : points) {
    check(point.section >= 0 && point.section < sections, "the section of a point", point.section,
          "one that the arm has");
    check(point.s >= 0 && point.s <= 1, "s of a point", point.s, "0 to 1");
    check(notNegative(point.mass), "the mass of a point", point.mass, "a finite value >= 0 [kg]");
    basics::requireKey(
        point.force.allFinite() && point.moment.allFinite() && point.offset.allFinite(), "load",
        "force, moment or offset of a point is not finite");
  }
}

}  // namespace helix_arm::statics
