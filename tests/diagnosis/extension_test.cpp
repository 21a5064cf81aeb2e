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

TEST(Extension, OneOtherAxisIsAddedByItsMotionWhereItIsRecorded) {
  Segment alone;
  alone.sample_time_s = 1e-3;
  alone.command = Eigen::ArrayXd::LinSpaced(100, 0.0, 1.0);
  Segment commanded = alone, moving = alone;
  commanded.neighbour = moving.neighbour = alone.command;
  moving.neighbour_motion = alone.command;
  const auto couplings = [](const Segment& s, const std::vector<std::size_t>& effects) {
    std::vector<std::size_t> out =
        candidates_of({2, effects}, {}, {}, Channels(std::vector<Segment>{s}));
    std::erase_if(out, [](std::size_t kind) { return !couples(kind); });
    return out;
  };
  const std::vector<std::size_t> law{kind_of<CoulombFriction>()};
  EXPECT_THAT(couplings(alone, law), ElementsAre());
  EXPECT_THAT(couplings(commanded, law), ElementsAre(kind_of<CrossCoupling>()));
  EXPECT_THAT(couplings(moving, law), ElementsAre(kind_of<CrossCouplingByMotion>()));
  EXPECT_THAT(couplings(moving, {law[0], kind_of<CrossCoupling>()}), ElementsAre());
}

}  // namespace
}  // namespace servotwin
