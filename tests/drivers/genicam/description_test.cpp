// Descriptions that no library can evaluate to the end.
#include "drivers/genicam/description.hpp"

#include <gtest/gtest.h>

#include <string>

#include "tests/refusal.hpp"

namespace bolo::genicam::description_test {
namespace {

Status checked(const std::string& nodes) {
  const std::string xml =
      "<?xml version=\"1.0\"?><RegisterDescription ModelName=\"x\" "
      "xmlns=\"http://www.genicam.org/GenApi/Version_1_1\">" +
      nodes + "</RegisterDescription>";
  const Ref<ArvGc> description(arv_gc_new(nullptr, xml.data(), xml.size()));
  EXPECT_NE(description, nullptr);
  return check_description(description.get());
}

std::string integer(const std::string& name, const std::string& from) {
  return "<Integer Name=\"" + name + "\"><pValue>" + from + "</pValue></Integer>";
}

TEST(Description, ValuesThatAreTakenFromThemselves) {
  expect_refused(checked(integer("Width", "Width")), {"without an end", "Width"});
  expect_refused(checked(integer("Width", "Height") + integer("Height", "Width")), {"without an end"});
  expect_refused(
      checked("<IntReg Name=\"R\"><pAddress>A</pAddress></IntReg><IntSwissKnife Name=\"A\"><pVariable Name=\"V\">"
              "R</pVariable><Formula>V+1</Formula></IntSwissKnife>"),
      {"without an end"});
  expect_refused(checked("<IntReg Name=\"R\"><IntSwissKnife Name=\"A\"><pVariable Name=\"V\">R</pVariable><Formula>V"
                         "</Formula></IntSwissKnife></IntReg>"),
                 {"without an end"});
}

TEST(Description, ValuesThatTakeForEver) {
  std::string chain;
  std::string from_the_end;
  std::string doubled;
  for (int i = 0; i < 1000; ++i) chain += integer("N" + std::to_string(i), "N" + std::to_string(i + 1));
  for (int i = 9000; i > 1000; --i) from_the_end += integer("N" + std::to_string(i), "N" + std::to_string(i - 1));
  for (int i = 0; i < 60; ++i) {
    const std::string next = "N" + std::to_string(i + 1);
    doubled += "<IntSwissKnife Name=\"N" + std::to_string(i) + "\"><pVariable Name=\"A\">" + next +
               "</pVariable><pVariable Name=\"B\">" + next + "</pVariable><Formula>A+B</Formula></IntSwissKnife>";
  }
  expect_refused(checked(chain), {"without an end"});
  expect_refused(checked(from_the_end), {"without an end"});
  expect_refused(checked(doubled), {"without an end"});
}

// Limits of two features name one another, and a selector what it selects.
TEST(Description, WhatRealCamerasSayIsTaken) {
  EXPECT_TRUE(checked(""));
  EXPECT_TRUE(
      checked("<Category Name=\"Root\"><pFeature>Width</pFeature></Category>"
              "<Integer Name=\"Width\"><pValue>W</pValue><pMax>Most</pMax><pSelected>Offset</pSelected></Integer>"
              "<IntSwissKnife Name=\"Most\"><pVariable Name=\"O\">Offset</pVariable><Formula>640-O</Formula>"
              "</IntSwissKnife>"
              "<Integer Name=\"Offset\"><pValue>O</pValue><pMax>Left</pMax></Integer>"
              "<IntSwissKnife Name=\"Left\"><pVariable Name=\"W\">Width</pVariable><Formula>640-W</Formula>"
              "</IntSwissKnife>"
              "<IntReg Name=\"W\"><Address>1</Address></IntReg><IntReg Name=\"O\"><Address>2</Address></IntReg>"));
}

}  // namespace
}  // namespace bolo::genicam::description_test
