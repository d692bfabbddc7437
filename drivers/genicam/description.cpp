#include "drivers/genicam/description.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/printable.hpp"

namespace bolo::genicam {
namespace {

constexpr int kMostDeep = 100;
constexpr double kMostSteps = 1e5;

// Where the value itself is taken from. What a camera says beside these (limits, access, selected features) is
// evaluated apart, and does name the node again.
constexpr std::array<std::string_view, 8> kTakenFrom{"pValue",        "pVariable", "pIndex",  "pValueIndexed",
                                                     "pValueDefault", "pAddress",  "pLength", "pOffset"};

std::string text_of(ArvDomNode* node) {
  std::string text;
  for (ArvDomNode* child = arv_dom_node_get_first_child(node); child != nullptr;
       child = arv_dom_node_get_next_sibling(child)) {
    const char* part = arv_dom_node_get_node_value(child);
    if (part != nullptr) text += part;
  }
  return text;
}

// To evaluate a value.
struct Effort {
  double steps = 1.0;
  int deep = 0;  // values taken one within the other
};

class Description {
 public:
  explicit Description(ArvGc* description) {
    collect(ARV_DOM_NODE(arv_dom_document_get_document_element(ARV_DOM_DOCUMENT(description))), {});
  }

  Status check() {
    for (const auto& [name, ignored] : taken_from_) {
      if (!effort_of(name, 0)) {
        return bad_input("its GenICam description has values without an end, such as " + printable(name.substr(0, 80)));
      }
    }
    return {};
  }

 private:
  // As deep as the document, which its parser limits. `owners`: the named nodes that `node` is part of.
  void collect(ArvDomNode* node, std::vector<std::string> owners) {
    if (node == nullptr || !ARV_IS_DOM_ELEMENT(node)) return;
    const std::string_view tag = arv_dom_node_get_node_name(node);
    if (std::ranges::find(kTakenFrom, tag) != kTakenFrom.end()) {
      const std::string from = text_of(node);
      for (const std::string& owner : owners) taken_from_[owner].push_back(from);
      return;
    }
    const char* const name = arv_dom_element_get_attribute(ARV_DOM_ELEMENT(node), "Name");
    if (name != nullptr) owners.emplace_back(name);
    for (ArvDomNode* child = arv_dom_node_get_first_child(node); child != nullptr;
         child = arv_dom_node_get_next_sibling(child)) {
      collect(child, owners);
    }
  }

  // Nothing: it has no end, or none that is near. `within`: values that are taken from this one.
  std::optional<Effort> effort_of(const std::string& name, int within) {
    const auto found = taken_from_.find(name);
    if (found == taken_from_.end()) return Effort{};
    if (const auto known = efforts_.find(name); known != efforts_.end()) return known->second;
    Effort effort;
    for (const std::string& from : found->second) {
      const auto more = within < kMostDeep ? effort_of(from, within + 1) : std::nullopt;
      if (!more) return std::nullopt;
      effort.steps += more->steps;
      effort.deep = std::max(effort.deep, more->deep + 1);
    }
    if (effort.steps > kMostSteps || effort.deep > kMostDeep) return std::nullopt;
    efforts_.emplace(name, effort);
    return effort;
  }

  std::map<std::string, std::vector<std::string>> taken_from_;  // by name
  std::map<std::string, Effort> efforts_;                       // of those that have an end
};

}  // namespace

Status check_description(ArvGc* description) {
  return description != nullptr ? Description(description).check() : Status{};  // without one nothing is evaluated
}

}  // namespace bolo::genicam
