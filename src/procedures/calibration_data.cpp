#include "helix_arm/procedures/calibration_data.hpp"

#include <algorithm>
#include <iterator>
#include <map>
#include <set>
#include <utility>

#include "helix_arm/io/number.hpp"
#include "helix_arm/procedures/captures.hpp"

namespace helix_arm::procedures {

void addCaptures(std::vector<estimation::Capture> captures, const std::string& file,
                 CalibrationData& data) {
  std::set<int> taken;
  for (const estimation::Capture& one : data.captures) taken.insert(one.number);
  const bool meet = std::any_of(captures.begin(), captures.end(),
                                [&taken](const auto& one) { return taken.count(one.number) > 0; });
  if (meet) {
    const int offset = *taken.rbegin();
    for (estimation::Capture& one : captures) one.number += offset;
    data.warnings.push_back("captures of " + file + " are renumbered: their number + " +
                            std::to_string(offset));
  }
  std::move(captures.begin(), captures.end(), std::back_inserter(data.captures));
}

CalibrationData loadCalibrationData(const io::Scene& scene, const std::vector<std::string>& paths) {
  CalibrationData out;
  for (const std::string& path : paths) {
    const io::DataSet data = io::loadDataSet(path);
    int count = 0;
    if (kindOf(data) == DataKind::kLengths) {
      const std::vector<estimation::LengthSample> samples = loadLengths(data);
      out.lengths.insert(out.lengths.end(), samples.begin(), samples.end());
      count = static_cast<int>(samples.size());
    } else {
      LoadedCaptures read = loadCaptures(scene, data);
      count = static_cast<int>(read.captures.size());
      if (!read.unknown_tags.empty()) {
        out.warnings.push_back(
            path + " has tags that are not in the scene: " + io::listOf(read.unknownIds()));
      }
      addCaptures(std::move(read.captures), path, out);
    }
    out.sources.push_back({path, data.sha256, count});
  }
  return out;
}

std::optional<std::string> repeatedSource(const std::vector<io::Provenance::Data>& sources) {
  std::map<std::string, std::string> files;
  for (const io::Provenance::Data& source : sources) {
    const auto [known, is_new] = files.emplace(source.sha256, source.file);
    if (!is_new) {
      return source.file + " has the same content as " + known->second +
             "; give each data set once";
    }
  }
  return std::nullopt;
}

}  // namespace helix_arm::procedures
