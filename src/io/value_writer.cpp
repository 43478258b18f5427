#include "value_writer.hpp"

#include <algorithm>

#include "helix_arm/io/number.hpp"

namespace helix_arm::io {

Value plainValue(const std::string& text) {
  Value value;
  value.kind = Value::Kind::kText;
  value.text = text;
  return value;
}

Value numberValue(double number) { return plainValue(formatNumber(number)); }

Value numbersValue(const Eigen::VectorXd& numbers) {
  Value list;
  list.kind = Value::Kind::kList;
  for (const double number : numbers) list.entries.push_back({{}, numberValue(number)});
  return list;
}

Value listValue(const std::vector<Value>& values) {
  Value list;
  list.kind = Value::Kind::kList;
  for (const Value& value : values) list.entries.push_back({{}, value});
  return list;
}

Value* findValue(Value& map, const std::string& key) {
  const auto found = std::find_if(map.entries.begin(), map.entries.end(),
                                  [&key](const Value::Entry& entry) { return entry.key == key; });
  return found == map.entries.end() ? nullptr : &found->value;
}

void setValue(Value& map, const std::string& key, Value value) {
  if (Value* present = findValue(map, key)) {
    *present = std::move(value);
  } else {
    map.entries.push_back({key, std::move(value)});
  }
}

void eraseValue(Value& map, const std::string& key) {
  map.entries.erase(std::remove_if(map.entries.begin(), map.entries.end(),
                                   [&key](const Value::Entry& entry) { return entry.key == key; }),
                    map.entries.end());
}

void MapWriter::text(const std::string& key, const std::string& text) {
  Value value = plainValue(text);
  value.quoted = true;
  set(key, std::move(value));
}

}  // namespace helix_arm::io
