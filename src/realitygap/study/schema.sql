CREATE TABLE run (            -- one evolutionary run; its numbers are those of its checkpoint
    id INTEGER PRIMARY KEY,   -- from 1, condition by condition
    name TEXT NOT NULL UNIQUE,
    task TEXT NOT NULL,
    noise REAL NOT NULL,      -- level: 0 zero, 1 observed, 2 double
    position INTEGER NOT NULL, -- from 1 within its condition
    encoding TEXT NOT NULL,   -- JSON: dtype and shape of its genotypes, the encoding's name and settings
    evaluations INTEGER NOT NULL DEFAULT 0,
    best_fitness REAL,        -- highest fitness stored so far, of evaluation `fittest`
    fittest INTEGER,
    champion INTEGER,         -- evaluation number of the best in the retest, once finished
    champion_fitness REAL,    -- its mean score in the retest
    finished INTEGER NOT NULL DEFAULT 0
);
CREATE TABLE checkpoint (     -- what a run goes on from; written with the evaluations before it
    run INTEGER PRIMARY KEY REFERENCES run(id),
    evaluations INTEGER NOT NULL,
    state BLOB NOT NULL
);
CREATE TABLE tested (         -- fresh trials of a finished run
    run INTEGER NOT NULL REFERENCES run(id),
    who TEXT NOT NULL,        -- fittest, champion; population: the retest of everyone that lived last
    noise REAL NOT NULL,      -- level
    cell INTEGER NOT NULL,    -- of the population; -1: fittest or champion
    number INTEGER NOT NULL,  -- evaluation number
    scores BLOB NOT NULL,     -- float64, little-endian, a trial each
    PRIMARY KEY (run, who, noise, cell)
) WITHOUT ROWID;
CREATE TABLE session (        -- who has worked on this study, and with which versions
    id INTEGER PRIMARY KEY,
    began TEXT NOT NULL,      -- UTC
    pid INTEGER NOT NULL,
    versions TEXT NOT NULL    -- JSON
);
CREATE TABLE source (         -- all that the study follows from, as it was when it was made
    name TEXT PRIMARY KEY,    -- a file's, from the study's folder
    content BLOB NOT NULL
);
CREATE TABLE task (           -- what a task is, beside its score: nobody has to run its file for that
    name TEXT PRIMARY KEY,
    facts TEXT NOT NULL       -- JSON
);
CREATE TABLE digest (         -- of the rows of a table that belong to a run; run 0: of the whole table
    run INTEGER NOT NULL,
    part TEXT NOT NULL,
    value BLOB NOT NULL,
    PRIMARY KEY (run, part)
) WITHOUT ROWID;

CREATE TABLE evolved (        -- everyone that was ever evaluated, as many to a row as were kept at once; in one, once
    run INTEGER NOT NULL REFERENCES run(id), -- the run is finished
    number INTEGER NOT NULL,  -- of the first of them, from 0 within its run
    count INTEGER NOT NULL,   -- how many
    scores BLOB NOT NULL,     -- float64, little-endian, [count, trials]
    fitness BLOB NOT NULL,    -- float64 [count]: means of their scores; empty: of one score or two, as SQL has them
    places BLOB NOT NULL,     -- uint16, or uint32 if need be, [count, 3]: the evaluation numbers of both parents and
                              -- the cell that each took, or was offered; 1 more than they are (0: none)
    genotypes BLOB NOT NULL,  -- LZMA: one after the other, of the dtype and shape in run.encoding
    PRIMARY KEY (run, number)
) WITHOUT ROWID;
