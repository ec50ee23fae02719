from .causes import run_parts as run_parts
from .checkup import (
    Checkup as Checkup,
    cure as cure,
    doctor as doctor,
    doubt_lines as doubt_lines,
    require_own as require_own,
    scene_doubts as scene_doubts,
)
from .comparison import (
    HYPOTHESIS_CONTROLS as HYPOTHESIS_CONTROLS,
    compare as compare,
    compare_files as compare_files,
    control_names as control_names,
    is_run as is_run,
)
from .conformance_checks import check_agent as check_agent
from .conformance_playing import Finding as Finding
from .drives import compare_driving as compare_driving
from .evaluation import (
    EnvEvaluation as EnvEvaluation,
    evaluate as evaluate,
    scores_of as scores_of,
)
from .forecast_export import (
    ForecastForm as ForecastForm,
    export_forecasts as export_forecasts,
)
from .forecast_import import import_forecasts as import_forecasts
from .level_runs import measured_delay as measured_delay, robustness as robustness
from .levels import (
    LEVELS as LEVELS,
    Level as Level,
    LevelRow as LevelRow,
    Robustness as Robustness,
)
from .official import official_scores as official_scores
from .options import (
    DEFAULTS as DEFAULTS,
    MAX_SEED as MAX_SEED,
    Fold as Fold,
    RunKeywords as RunKeywords,
    RunOptions as RunOptions,
    fold_of as fold_of,
    held_out as held_out,
    require_seed as require_seed,
    resolve_options as resolve_options,
)
from .playing import (
    PLAYER_ROOMS as PLAYER_ROOMS,
    agent_task as agent_task,
    all_kernels as all_kernels,
    compile_kernels as compile_kernels,
    derived_seed as derived_seed,
    jobs_of as jobs_of,
    library_versions as library_versions,
    run_jobs as run_jobs,
)
from .reading import read_status as read_status, skipped_line as skipped_line
from .reference import (
    card_budget as card_budget,
    freeze as freeze,
    frozen_reference as frozen_reference,
    make_reference as make_reference,
    ranked_scenes as ranked_scenes,
    reference_for as reference_for,
)
from .rollout_files import (
    RunInfo as RunInfo,
    load_run as load_run,
    require_run_folder as require_run_folder,
    save_run as save_run,
)
from .settings import (
    Setting as Setting,
    all_settings as all_settings,
    other_split as other_split,
    references_of as references_of,
    scenes_of_card as scenes_of_card,
    setting_of as setting_of,
)
from .stored import (
    OpenedRun as OpenedRun,
    open_run as open_run,
    open_runs as open_runs,
    require_free as require_free,
    run as run,
    run_info as run_info,
    score as score,
    score_opened as score_opened,
)
from .track_export import export_tracks as export_tracks
