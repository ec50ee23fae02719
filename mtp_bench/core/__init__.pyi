from .arrays import (
    NO_ROWS as NO_ROWS,
    Action as Action,
    Bools as Bools,
    Floats as Floats,
    Ints as Ints,
    Observation as Observation,
    Ragged as Ragged,
    joined as joined,
    select as select,
    starts_of as starts_of,
    starts_of_sorted as starts_of_sorted,
)
from .bundle import (
    baseline_names as baseline_names,
    bundled as bundled,
    card_ids as card_ids,
)
from .errors import (
    ActionError as ActionError,
    CardError as CardError,
    DataError as DataError,
    MissingDataError as MissingDataError,
    MtpBenchError as MtpBenchError,
    RecordError as RecordError,
    RolloutError as RolloutError,
    ShapeError as ShapeError,
    SubmissionError as SubmissionError,
    UnknownNameError as UnknownNameError,
    closest as closest,
    describe_problem as describe_problem,
    nearest as nearest,
    require_finite as require_finite,
    require_known as require_known,
    require_shape as require_shape,
)
from .files import (
    ABSENT as ABSENT,
    CACHE as CACHE,
    FULL_DISK as FULL_DISK,
    WriteError as WriteError,
    cache_root as cache_root,
    clean_text as clean_text,
    describe_write_error as describe_write_error,
    file_digest as file_digest,
    file_kind as file_kind,
    file_stem as file_stem,
    locked as locked,
    make_folder as make_folder,
    new_folder as new_folder,
    open_regular as open_regular,
    read_bounded as read_bounded,
    remove_damaged as remove_damaged,
    remove_leftovers as remove_leftovers,
    require_file as require_file,
    require_folder as require_folder,
    require_replaceable as require_replaceable,
    toml_beside as toml_beside,
    unseen as unseen,
    whole_file as whole_file,
    whole_folder as whole_folder,
    write_bytes as write_bytes,
    write_text as write_text,
)
from .geometry import (
    bev_corners as bev_corners,
    center_distance as center_distance,
    iou_3d as iou_3d,
    rotate as rotate,
    transform_boxes as transform_boxes,
    unit_vectors as unit_vectors,
    wrap_angle as wrap_angle,
)
from .networks import (
    PACKED as PACKED,
    SHIPPED as SHIPPED,
    VARIABLE as VARIABLE,
    NetworkState as NetworkState,
    file_name as file_name,
    network_files as network_files,
    states_of as states_of,
    weights_folder as weights_folder,
)
from .notice import (
    NO_PROGRESS as NO_PROGRESS,
    QUIET as QUIET,
    Progress as Progress,
    long_work as long_work,
    say_once as say_once,
)
from .parallel import (
    SERIAL as SERIAL,
    WorkerDiedError as WorkerDiedError,
    Workers as Workers,
    cores as cores,
    parallel_map as parallel_map,
    require_cluster as require_cluster,
    unordered_map as unordered_map,
)
from .rollout import (
    HARD_BRAKING as HARD_BRAKING,
    Drive as Drive,
    Rollout as Rollout,
    to_centimetres as to_centimetres,
    to_metres as to_metres,
)
from .scenes import (
    Detections as Detections,
    ImageField as ImageField,
    Lane as Lane,
    Scene as Scene,
    StoredTracks as StoredTracks,
    Truth as Truth,
)
from .similar import (
    class_hint as class_hint,
    of_kind as of_kind,
    similar_class as similar_class,
)
from .strict import (
    Section as Section,
    SectionT as SectionT,
    explain as explain,
    parse_json as parse_json,
    read_json as read_json,
    read_toml as read_toml,
    require_part as require_part,
    rule as rule,
    validate as validate,
)
from .table import (
    BLANK as BLANK,
    Column as Column,
    Table as Table,
    Value as Value,
    cell_text as cell_text,
    columns_of as columns_of,
    counted as counted,
    short as short,
)
from .table_writers import (
    SUFFIXES as SUFFIXES,
    table_lines as table_lines,
    tables_text as tables_text,
    to_csv as to_csv,
    to_html as to_html,
    to_json as to_json,
    to_latex as to_latex,
    to_markdown as to_markdown,
    to_text as to_text,
)
from .task import (
    ABSENT_BELOW as ABSENT_BELOW,
    ID_LIMIT as ID_LIMIT,
    SCORES as SCORES,
    Task as Task,
)
from .time_holes import pieces_of as pieces_of
from .tracks import (
    UNBORN as UNBORN,
    Affinity as Affinity,
    Objects as Objects,
    Tracks as Tracks,
    group as group,
)
from .version import __version__ as __version__
