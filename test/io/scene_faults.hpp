#pragma once

#include <algorithm>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/scene.hpp"
#include "support/has.hpp"
#include "support/scene_text.hpp"
#include "support/shipped_scene.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {

/// The scene of a text.
inline io::Scene sceneOf(const std::string& text, const std::vector<io::Override>& overrides = {}) {
  return io::loadScene(TemporaryFile(text).path(), overrides);
}

/// What a scene says of vision, except for rotations, which are converted: all else is bit for bit.
inline auto membersOf(const vision::LocalizerConfig& config) {
  const vision::DetectorConfig& d = config.detector;
  const estimation::TwistFitOptions& fit = config.fit;
  return std::tie(d.family, d.quad_decimate, d.quad_sigma, d.threads, d.refine_edges, d.max_hamming,
                  config.tracking, config.min_tags, fit.corner_noise, fit.position_noise,
                  fit.robust_scale, fit.base_prior.translation, fit.border_shift_prior);
}

/// What it says of the loop over vision, except for rotations.
inline auto membersOf(const follow::VisualServoConfig& loop) {
  return std::tie(loop.smoothing, loop.stale_after, loop.coast_time, loop.watch_creep,
                  loop.reading_noise, loop.filter.hysteresis, loop.filter.creep,
                  loop.filter.settling_time, loop.filter.bias_translation, loop.on_contact,
                  loop.contact.limit);
}

using Faults = std::vector<std::string>;

/// What loading says, without the path of the file; empty when it says nothing.
inline Faults faultsOf(const std::string& text, const std::vector<io::Override>& overrides = {}) {
  const TemporaryFile file(text);
  Faults faults;
  try {
    io::loadScene(file.path(), overrides);
  } catch (const io::DocumentError& error) {
    std::istringstream lines(error.what());
    for (std::string line; std::getline(lines, line);) {
      EXPECT_EQ(line.compare(0, file.path().size(), file.path()), 0) << line;
      faults.push_back(line.substr(file.path().size()));
    }
  }
  return faults;
}

/// The key that a text begins with; empty where it begins with none.
inline std::string keyIn(const std::string& text) {
  const std::size_t end = text.find_first_not_of("abcdefghijklmnopqrstuvwxyzK_0123456789");
  return end != std::string::npos && text.compare(end, 2, ": ") == 0 ? text.substr(0, end) : "";
}

/// A row of broken_rules.txt with the ends of its lines.
inline std::string withLineEnds(std::string row) {
  for (std::size_t at; (at = row.find("\\n")) != std::string::npos;) row.replace(at, 2, "\n");
  return row;
}

/// A rule of a document: one text is replaced by another, and all that is said then.
struct BrokenRule {
  std::string from, to;
  Faults faults;
};

/// @param row  of broken_rules.txt.
/// @param map  that holds the key, with a dot at its end.
inline BrokenRule brokenRule(std::string row, const std::string& map, const std::string& text) {
  row = withLineEnds(row);
  Faults columns;
  for (std::size_t at; (at = row.find(" | ")) != std::string::npos; row.erase(0, at + 3)) {
    columns.push_back(row.substr(0, at));
  }
  columns.push_back(row);
  BrokenRule rule{columns.at(0), columns.at(1), {columns.begin() + 2, columns.end()}};
  std::string& said = rule.faults.at(0);
  if (said[0] == ':') return rule;
  if (keyIn(rule.to).empty()) rule.to.insert(0, keyIn(rule.from) + ": ");
  const std::string key = keyIn(rule.to);
  const std::string value = rule.to.substr(key.size() + 2);
  said = said[0] == '~' ? said.substr(1) : " is " + value + "; expected " + said;
  const auto above = static_cast<std::ptrdiff_t>(std::min(text.find(rule.from), text.size()));
  const auto line = 1 + std::count(text.begin(), text.begin() + above, '\n');
  said.insert(0, ":" + std::to_string(line) + " " + map + key);
  return rule;
}

inline constexpr char kBrokenRules[] = HELIX_ARM_SOURCE_DIR "/test/io/broken_rules.txt";

/// Scenes of each kind of regulator, which broken_rules.txt has below "===", by their names there.
inline std::map<std::string, std::string> regulatorScenes() {
  std::map<std::string, std::string> scenes;
  std::ifstream rows(kBrokenRules);
  for (std::string row; std::getline(rows, row);) {
    if (row.compare(0, 4, "=== ") != 0) continue;
    const std::size_t end = row.find(' ', 4);
    scenes[row.substr(4, end - 4)] = kPlanarScene + withLineEnds(row.substr(end + 1)) + "\n";
  }
  return scenes;
}

/// Breaks each of the rules that broken_rules.txt has for a text that breaks none.
/// @param document  its name there.
/// @param file  its name in the faults.
template <class FaultsOf>
void expectFaults(const std::string& document, const std::string& text, const FaultsOf& faults_of,
                  const std::string& file) {
  ASSERT_EQ(faults_of(text), Faults());
  std::ifstream rows(kBrokenRules);
  std::string of, map;
  int broken = 0;
  for (std::string row; std::getline(rows, row);) {
    if (row.compare(0, 3, "== ") == 0) {
      map.clear();
      std::istringstream(row.substr(3)) >> of >> map;
    } else if (of == document && !row.empty() && row.compare(0, 4, "=== ") != 0) {
      SCOPED_TRACE(row);
      BrokenRule rule = brokenRule(row, map, text);
      for (std::string& fault : rule.faults) fault.insert(0, file);
      EXPECT_EQ(faults_of(replaced(text, rule.from, rule.to)), rule.faults);
      ++broken;
    }
  }
  EXPECT_GT(broken, 5) << document;
}

/// The same of a scene.
inline void expectFaults(const std::string& document, const std::string& scene) {
  expectFaults(
      document, scene, [](const std::string& text) { return faultsOf(text); }, "");
}

}  // namespace helix_arm::test
