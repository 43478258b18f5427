#include "response_reader.hpp"

#include <optional>
#include <stdexcept>
#include <string>

#include "helix_arm/io/number.hpp"

namespace helix_arm::io {
namespace {

const NumberRule kResponseTime = within(kNotNegative, 0, 60, " s");
const NumberRule kPlayReach = within(kPositive, 1e-3, 1e4, " kPa");
const NumberRule kPlayWeight = within(kNotNegative, 0, model::Response::kMostWeight);

// Adds the plays of two lists; none if one of them has faults.
void readPlays(const MapReader& keys, model::Response& response) {
  const auto reach = keys.numbers("play_kpa", 0, kPlayReach);
  if (!reach) return;
  if (reach->empty()) {
    keys.complain("play_kpa",
                  "is empty; expected 1 to 4 numbers, or leave out play_kpa and "
                  "play_weight for none");
    return;
  }
  if (reach->size() > model::kMaxPlays) {
    keys.complain("play_kpa", "has " + std::to_string(reach->size()) +
                                  " entries; expected at most " + std::to_string(model::kMaxPlays));
    return;
  }
  for (std::size_t j = 1; j < reach->size(); ++j) {
    if ((*reach)[j] > (*reach)[j - 1]) continue;
    keys.complain("play_kpa", "has " + formatNumber((*reach)[j]) + " after " +
                                  formatNumber((*reach)[j - 1]) + "; expected ascending values");
    return;
  }
  const auto weight = keys.numbers("play_weight", reach->size(), kPlayWeight);
  if (!weight) return;
  double sum = 0.0;
  for (std::size_t j = 0; j < reach->size(); ++j) {
    response.plays[j] = {pascals((*reach)[j]), (*weight)[j]};
    sum += (*weight)[j];
  }
  try {
    response.play_count = static_cast<int>(reach->size());
    response.validate();
  } catch (const std::invalid_argument&) {
    response.play_count = 0;
    keys.complain("play_weight", "has the sum " + formatNumber(sum) + "; expected at most " +
                                     formatNumber(model::Response::kMostWeight) +
                                     ", so that every length belongs to one pressure");
  }
}

}  // namespace

model::Response readResponse(const Value& value, const std::string& path, FaultList& faults) {
  const MapReader keys(value, path,
                       {"rise_time_constant_s", "fall_time_constant_s", "play_kpa", "play_weight"},
                       faults);
  model::Response response;
  response.rise_time = keys.number("rise_time_constant_s", kResponseTime, 0.0);
  response.fall_time = keys.number("fall_time_constant_s", kResponseTime, response.rise_time);
  if (keys.has("play_kpa")) {
    readPlays(keys, response);
  } else if (keys.has("play_weight")) {
    keys.complain("play_weight", "is given without play_kpa; expected both or none");
  }
  return response;
}

}  // namespace helix_arm::io
