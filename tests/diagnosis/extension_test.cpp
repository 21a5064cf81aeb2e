// Adding effects to structures and removing causes from them.
#include "diagnosis/search/extension.h"

#include <gmock/gmock.h>

#include "twin/catalogue.h"

namespace servotwin {
namespace {

using testing::ElementsAre;

TEST(Extension, WithoutACauseWhatItsEffectReplacedReturns) {
  const Structure law{2, {kind_of<PreslidingStribeck>(), kind_of<Cogging>()}};
  EXPECT_THAT(without(law, "stribeck", kind_of<PreslidingStribeck>()).effects,
              ElementsAre(kind_of<Presliding>(), kind_of<Cogging>()));
  EXPECT_THAT(
      without(law, "presliding", kind_of<PreslidingStribeck>()).effects,
      ElementsAre(kind_of<CoulombFriction>(), kind_of<Cogging>(), kind_of<FallingFriction>()));
  EXPECT_THAT(without(law, "cogging", kind_of<Cogging>()).effects,
              ElementsAre(kind_of<PreslidingStribeck>()));
}

// Regression: removing an effect that another one had replaced wrote beyond the end of the list.
TEST(Extension, WithoutWhatIsNotInItAStructureStaysAsItIs) {
  const Structure base{2, {kind_of<LuGre>(), kind_of<AsymmetricFriction>()}};
  for (const std::size_t kind :
       {kind_of<ConstantForce>(), kind_of<Cogging>(), kind_of<PreslidingStribeck>()}) {
    EXPECT_EQ(without(base, "presliding", kind).effects, base.effects);
  }
}

}  // namespace
}  // namespace servotwin
