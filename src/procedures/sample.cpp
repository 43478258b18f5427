#include "helix_arm/procedures/sample.hpp"

#include <algorithm>
#include <map>

#include "helix_arm/basics/median.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::procedures {

Sample medianOf(const std::vector<Sample>& samples) {
  basics::require(!samples.empty(), "a median of no samples; expected at least one");
  Sample out{samples.back().time, samples.back().pressure, {}};
  std::map<int, std::vector<const TagObservation*>> observations;
  for (const Sample& sample : samples) {
    basics::require(sample.pressure.size() == out.pressure.size(), "samples of ",
                    sample.pressure.size(), " and of ", out.pressure.size(),
                    " pressures; expected those of one arm");
    out.time = std::max(out.time, sample.time);
    for (const TagObservation& tag : sample.tags) observations[tag.id].push_back(&tag);
  }
  std::vector<double> values;
  const auto median = [&values](const auto& entries, const auto& valueOf) {
    values.clear();
    for (const auto& entry : entries) values.push_back(valueOf(entry));
    return basics::medianOf(values);
  };
  for (Eigen::Index i = 0; i < out.pressure.size(); ++i) {
    out.pressure[i] = median(samples, [i](const Sample& s) { return s.pressure[i]; });
  }
  for (const auto& [id, seen] : observations) {
    if (2 * seen.size() < samples.size()) continue;
    TagObservation& tag = out.tags.emplace_back();
    tag.id = id;
    for (Eigen::Index k = 0; k < tag.corners.size(); ++k) {
      tag.corners(k) = median(seen, [k](const TagObservation* s) { return s->corners(k); });
    }
  }
  return out;
}

}  // namespace helix_arm::procedures
