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

void addDataSet(const io::Scene& scene, const io::DataSet& set, CalibrationData& data) {
  int count = static_cast<int>(set.values.rows());
  switch (kindOf(set)) {
    case DataKind::kLengths:
      append(lengthSeriesOf(set), set.path, data.lengths);
      break;
    case DataKind::kTipSeries:
      append(tipSeriesOf(set, scene.arm.actuatorCount()), set.path, data.tips);
      break;
    case DataKind::kCurvatures:
    case DataKind::kTagPoses:
    case DataKind::kTagCorners: {
      LoadedCaptures read = loadCaptures(scene, set);
      count = static_cast<int>(read.captures.size());
      if (!read.unknown_tags.empty()) {
        data.warnings.push_back(
            set.path + " has tags that are not in the scene: " + io::listOf(read.unknownIds()));
      }
      addCaptures(std::move(read.captures), set.path, data);
      break;
    }
  }
  data.sources.push_back({set.path, set.sha256, count});
}

CalibrationData loadCalibrationData(const io::Scene& scene, const std::vector<std::string>& paths) {
  CalibrationData out;
  for (const std::string& path : paths) addDataSet(scene, io::loadDataSet(path), out);
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
