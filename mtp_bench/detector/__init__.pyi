from .draws import (
    Draws as Draws,
    Memory as Memory,
    skewed_cdf as skewed_cdf,
    skewed_density as skewed_density,
)
from .false_positives import (
    SensedScene as SensedScene,
    detect_false_positives as detect_false_positives,
    reported_classes as reported_classes,
)
from .free import free_false_positives as free_false_positives
from .grid import (
    Grid as Grid,
    Neighbours as Neighbours,
    truth_grid as truth_grid,
    truth_neighbours as truth_neighbours,
)
from .near import (
    BESIDE_DISTANCES_M as BESIDE_DISTANCES_M,
    classes_of_same_noise as classes_of_same_noise,
    near_false_positives as near_false_positives,
)
from .profile import (
    DISTANCE_RANKS as DISTANCE_RANKS,
    SCORE_RANKS as SCORE_RANKS,
    SLOTS_PER_BOX as SLOTS_PER_BOX,
    ClassNoise as ClassNoise,
    FreeFalsePositives as FreeFalsePositives,
    HeadingNoise as HeadingNoise,
    Lapses as Lapses,
    NearFalsePositives as NearFalsePositives,
    PositionNoise as PositionNoise,
    Profile as Profile,
    Quality as Quality,
    SizeNoise as SizeNoise,
    Variant as Variant,
)
from .profile_file import (
    load_profile as load_profile,
    profile_for as profile_for,
    profile_names as profile_names,
    profile_text as profile_text,
    with_variant as with_variant,
)
from .quality import (
    Qualities as Qualities,
    draw_qualities as draw_qualities,
    quality_features as quality_features,
    random_quality as random_quality,
)
from .simulation import OpenScene as OpenScene, simulate as simulate
from .visibility import (
    Sensor as Sensor,
    covered as covered,
    polar as polar,
    visibility_of as visibility_of,
    visible_fractions as visible_fractions,
)
