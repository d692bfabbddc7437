// CPTV version 2: films of Lepton cameras as The Cacophony Project records them. The whole file is gzip's; each frame
// is the difference from the one before, and of that the differences along a snake through the rows, in as few bits as
// they need (github.com/TheCacophonyProject/go-cptv, SPECv2.md; the compression is scheme 1 of its reader).
#pragma once

#include "tools/convert/footage.hpp"

namespace bolo::tools {

// Values are counts unless `told` has a scale: the file does not say. Background frames, which a device computes, are
// passed over. Reads the file once for its structure, and again for the frames. Errors (kBadInput) name the file.
// Thread: any one at a time.
Result<std::unique_ptr<Footage>> open_cptv(const std::filesystem::path& file, const Told& told);

}  // namespace bolo::tools
