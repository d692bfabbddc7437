// The files of the page, built into the program.
#pragma once

#include <span>
#include <string_view>

namespace bolo::view {

struct PageFile {
  std::string_view name;  // as in tools/view/page
  std::string_view content;
};

// Thread: any.
std::span<const PageFile> page_files();

}  // namespace bolo::view
