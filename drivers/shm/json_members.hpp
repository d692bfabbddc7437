// The text of a JSON object, member by member. The JSON library's trees take memory when they are destroyed, and end
// the process where it is refused: a daemon makes none.
#pragma once

#include <string>
#include <string_view>

#include <nlohmann/json.hpp>

namespace bolo::shm {

// Thread: any, one at a time.
class JsonMembers {
 public:
  // A number, text, truth or null. The key is written as it is.
  void add(std::string_view key, const nlohmann::json& leaf) { add_text(key, leaf.dump()); }
  // What is JSON already.
  void add_text(std::string_view key, const std::string& json) {
    members_.append(members_.empty() ? "\"" : ",\"").append(key).append("\":").append(json);
  }
  std::string text() const { return "{" + members_ + "}"; }

 private:
  std::string members_;
};

}  // namespace bolo::shm
